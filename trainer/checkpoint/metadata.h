// SPDX-License-Identifier: Apache-2.0
// What a checkpoint says of itself: one struct from the trainer that makes it to whoever reads it.
//
// In the file (all values text; * JSON): format "etude checkpoint N" (N: schema.h), version (of the program, for
// people), run, step, stage, stages, stage_name, best, train_episodes, dataset (fingerprint), words (that its training
// said; files from before it have none), architecture, embodiment*, modules*, refused (why it may not drive a robot
// yet; empty: it may), metrics*, policy_config* (what differs from the defaults), train_config* (everything).
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "services/core/config.h"
#include "services/core/result.h"
#include "trainer/checkpoint/embodiment.h"
#include "trainer/policy/config.h"

namespace etude::checkpoint {

/// What has been done for one module.
struct ModuleRecord {
  std::uint64_t trained_steps = 0;  ///< optimiser steps in which it had a loss and was not frozen
  std::optional<double> error;      ///< of its last validation (1 - accuracy, px, m); nothing: never measured
};

OrderedJson ModulesToJson(const std::map<std::string, ModuleRecord>& modules);
/// @error kCorrupt
Result<std::map<std::string, ModuleRecord>> ModulesFromJson(const OrderedJson& json);

struct Metadata {
  std::string run;
  std::string version;  ///< of the program that wrote it; nothing depends on it
  std::uint64_t step = 0;
  int stage = 1, stages = 1;
  std::string stage_name;
  bool best = false;  ///< of its run, when it was written
  std::uint64_t train_episodes = 0;
  std::string dataset;  ///< fingerprint of the training split
  /// That sentences of its training have, separated by spaces (language::SeenWords); "": not known.
  std::string words;
  Embodiment embodiment;
  std::map<std::string, ModuleRecord> modules;
  std::map<std::string, double> metrics;  ///< of the last validation, for people
  policy::PolicyConfig policy;
  OrderedJson train_config = OrderedJson::object();
};

/// The text that stands in a file of today's schema.
std::map<std::string, std::string> ToText(const Metadata& metadata);

/// Of text of today's schema (schema.h makes it so). @error kCorrupt: what is missing or malformed, by key; an
/// architecture that is not the configuration's.
Result<Metadata> FromText(const std::map<std::string, std::string>& text);

/// The policy as a file would say it, for other data: without a crop that was derived from its camera.
OrderedJson GraphOf(const Metadata& metadata);

/// For people and for the bus: everything but the configurations.
OrderedJson Summary(const Metadata& metadata);

}  // namespace etude::checkpoint
