// SPDX-License-Identifier: Apache-2.0
// `etude policy watch`: what a policy thinks while it drives, in the terminal.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/identity.h"

namespace etude::serve {

struct WatchOptions {
  Selector run;
  std::string session;            ///< "": anybody's
  std::string sentence;           ///< what if this had been said
  std::vector<std::string> hide;  ///< "U,V,WIDTH,HEIGHT" px
  /// "U,V,WIDTH,HEIGHT" px: what nobody attends to
  std::vector<std::string> look_away;
  std::vector<std::string> say;    ///< "TAR3D.position=[0.1, 0.3, 0.04]", "LANG.class=coke"
  std::vector<std::string> think;  ///< "LANG=push the coke", "LANG=zero"
  std::uint64_t count = 0;         ///< insights until it ends; 0: until a stop request
  bool as_json = false;            ///< a line each
  bool worth = false;              ///< what each word and joint is worth, too
};

/// The wish's what-if text. @error kInvalidArgument: an option that cannot be read
Result<std::string> WhatIfOf(const WatchOptions& options);

/// Whether an insight that is an error is one of the wish, or of the only session that is watched; else another robot's
/// observation is one that this policy does not answer.
bool EndsTheWatch(const bus::Insight& insight, const WatchOptions& options);

/// Until a stop request, `count` or an error of stdout. A server that goes is waited for, and another one that the name
/// means by then is looked into.
/// @error kInvalidArgument: the name means several servers; one that EndsTheWatch
Status Watch(const bus::Participant& participant, const WatchOptions& options);

}  // namespace etude::serve
