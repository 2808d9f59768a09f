// SPDX-License-Identifier: Apache-2.0
#include "services/cli/reference.h"

#include <fmt/format.h>

#include <map>

#include "services/bus/blob_transfer.h"
#include "services/bus/topology.h"
#include "services/cli/all_commands.h"
#include "services/cli/sibling_text.h"
#include "services/core/file.h"
#include "services/core/identity.h"

namespace etude::cli {
namespace {

struct ReferenceArguments {
  std::string out, proto = "proto";
  BusArguments bus;
};

using Pages = std::map<std::string, std::string>;  // file name -> text

Result<std::string> ConfigPage() {
  struct File {
    const char* kind;
    const char* intro;
  };
  static constexpr File kFiles[] = {
      {"campaign", "What to collect: the files of `deploy/campaigns`, for `etude collect` and `etude collector`."},
      {"experiment", "How to train: `etude train --config`, and `--set` of it."},
      {"up", "The whole loop: the files of `deploy/up`, for `etude up`."},
      {"robot", "A robot of your own: the files of `deploy/robots`, for `etude robot check`."},
      {"results", "A table of results: `deploy/docs/results.yaml`, for `etude results`."}};
  std::string page =
      "# Configuration files\n\nYAML; `--set key=value` overrides a key; a key that is not here is refused with the "
      "nearest match. `[]` in a key: of each item of a list; `NAME`: of each entry of a map.\n";
  for (const auto& [kind, intro] : kFiles) {
    ETUDE_ASSIGN_OR_RETURN(const auto keys, AskSiblingJson("etude", {"config", "describe", kind, "--json"}));
    page += ConfigSection(kind, intro, keys);
  }
  return page;
}

// The struct of that name in the IDL files, as it stands there.
Result<std::string> StructOf(const std::string& type, const Path& proto) {
  const std::string name = "struct " + type.substr(type.rfind(':') + 1) + " {";
  std::error_code error;
  for (std::filesystem::directory_iterator it(proto, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() != ".idl") continue;
    ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(it->path()));
    const auto at = text.find(name);
    if (at == std::string::npos) continue;
    const auto begin = text.rfind('\n', at) + 1;
    const auto close = text.find("};", at);
    if (close != std::string::npos) return text.substr(begin, close + 2 - begin);
  }
  if (error) return Fail(ErrnoError("list", proto, error.value()));
  return Fail(Code::kNotFound, fmt::format("find type '{}' of a topic in the IDL files of '{}'", type, proto.string()));
}

// Types and QoS are those that readers of every topic have, opened here and asked for.
Result<std::string> TopicsPage(const ReferenceArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  const std::string partition = "reference-" + NewId();
  std::vector<std::unique_ptr<bus::Echo>> readers;
  for (const auto& topic : bus::KnownTopics()) {
    ETUDE_ASSIGN_OR_RETURN(auto reader, bus::Echo::Open(participant, topic, partition));
    readers.push_back(std::move(reader));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto published, bus::BlobSubscriber::Open(participant, {"reference", NewId()}, ""));
  ETUDE_ASSIGN_OR_RETURN(const auto endpoints, bus::Endpoints(participant));
  const std::string own = bus::ParticipantId(participant);
  std::string table, types;
  for (const auto& endpoint : endpoints) {
    if (endpoint.participant != own || endpoint.is_writer || !endpoint.topic.starts_with("etude/")) continue;
    if (types.find("### " + endpoint.type + "\n") != std::string::npos) continue;
    table += fmt::format("| `{}` | `{}` | {} |\n", endpoint.topic, endpoint.type, bus::QosText(endpoint));
    ETUDE_ASSIGN_OR_RETURN(const std::string fields, StructOf(endpoint.type, arguments.proto));
    types += fmt::format("\n### {}\n\n```idl\n{}\n```\n", endpoint.type, fields);
  }
  return "# Topics\n\nWhat is on the bus: types and QoS as the readers of this build ask for. `proto/README.md` says "
         "who writes and who reads each, and what partitions are; `etude topic list` shows those of a live bus.\n\n"
         "| topic | type | QoS |\n|---|---|---|\n" +
         table + "\n## Types\n\nA field marked `@key` tells instances of a topic apart.\n" + types;
}

Result<Pages> MakePages(const CLI::App& app, const ReferenceArguments& arguments) {
  Pages pages;
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson commands, AllCommands(app));
  pages["commands.md"] = CommandsPage(commands);
  ETUDE_ASSIGN_OR_RETURN(pages["config.md"], ConfigPage());
  ETUDE_ASSIGN_OR_RETURN(pages["topics.md"], TopicsPage(arguments));
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson api, AskSiblingJson("etude-gateway", {"--describe", "http"}));
  pages["http.md"] = HttpPage(api);
  ETUDE_ASSIGN_OR_RETURN(const SiblingText metrics, AskSibling("etude-gateway", {"--describe", "metrics"}));
  pages["metrics.md"] = MetricsPage(metrics.text + "\n");
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson outcomes, AskSiblingJson("etude-worker", {"outcomes", "--json"}));
  pages["failures.md"] = FailuresPage(outcomes);
  return pages;
}

Status Write(const CLI::App& app, const ReferenceArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const Pages pages, MakePages(app, arguments));
  ETUDE_RETURN_IF_ERROR(MakeFolders(arguments.out));
  for (const auto& [name, text] : pages) {
    const Path file = Path(arguments.out) / name;
    ETUDE_RETURN_IF_ERROR(WriteFileAtomically(file, "<!-- made by `etude reference`; do not edit -->\n" + text));
    fmt::print("{}\n", file.string());
  }
  return {};
}

}  // namespace

void AddReference(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand(
      "reference", "write the reference pages: commands, config keys, topics, HTTP, metrics, how attempts end");
  auto arguments = std::make_shared<ReferenceArguments>();
  command->add_option("--out", arguments->out, "folder of the pages")->required();
  command->add_option("--proto", arguments->proto, "folder of the IDL files")->capture_default_str();
  arguments->bus.Add(*command);
  command->callback([arguments, &app, &body] { body = [arguments, &app] { return Write(app, *arguments); }; });
}

}  // namespace etude::cli
