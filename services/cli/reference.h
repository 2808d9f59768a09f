// SPDX-License-Identifier: Apache-2.0
// `etude reference`: the pages of deploy/docs/reference, made of what the programs say of themselves.
#pragma once

#include <string>

#include "services/cli/command_line.h"
#include "services/core/config.h"

namespace etude::cli {

/// `app` has to live until the body has run: what it offers is asked for then.
void AddReference(CLI::App& app, Body& body);

/// commands.md. @param commands  AllCommands
std::string CommandsPage(const OrderedJson& commands);
/// One file of config.md, under a heading. @param keys  as PrintReference writes them as JSON
std::string ConfigSection(const std::string& kind, const std::string& intro, const OrderedJson& keys);
/// http.md. @param api  an OpenAPI document
std::string HttpPage(const OrderedJson& api);
/// metrics.md. @param families  "# HELP" and "# TYPE" lines of a Prometheus exposition
std::string MetricsPage(const std::string& families);
/// failures.md. @param outcomes  [{outcome, meaning}]
std::string FailuresPage(const OrderedJson& outcomes);

}  // namespace etude::cli
