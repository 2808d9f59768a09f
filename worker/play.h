// SPDX-License-Identifier: Apache-2.0
// `etude worker play`: a scene that is kept on the bus for whoever wants to talk to a policy in it (proto/play.idl).
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "services/bus/arguments.h"
#include "services/campaign/spec_file.h"
#include "worker/sim/renderer.h"

namespace etude {

struct PlayOptions {
  campaign::SpecArguments spec;  ///< its file: a campaign's, or the folder of a dataset
  std::string run;               ///< whose policy is asked: NAME or NAME@ID
  std::string session;           ///< "": a name of its own
  std::uint64_t index = 0;       ///< episode whose scene it begins with
  double speed = 1;              ///< of the simulation against the clock; 0: as fast as it goes
  double idle_s = 900;           ///< it ends when nobody has asked for anything for so long; 0: never
};

/// Declares the subcommand.
CLI::App* AddPlay(CLI::App& app, PlayOptions& options);

/// Keeps the session until it is closed, idle, or a stop is requested. Prints "play SESSION" when it is there.
/// @error kInvalidArgument: spec, run or session; kNotFound: the episode has no scene; kUnavailable: no GL, no bus
Status Play(const PlayOptions& options, const bus::Arguments& bus, const sim::RendererConfig& renderer);

}  // namespace etude
