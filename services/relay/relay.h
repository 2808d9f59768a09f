// SPDX-License-Identifier: Apache-2.0
// Checkpoints outlive their trainer: a relay keeps the newest one of each channel of a run and publishes it when nobody
// else does any more, with the same version, hash, metadata and signature.
//
// It listens to the run itself, never to other relays, and publishes in the run's partition of relays, where an
// identity of role `relay` may write and one of role `trainer` need not. A subscriber hears both and takes each version
// once, so that several relays do no harm, and neither does one that offers what its trainer has as well.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/blob_transfer.h"
#include "services/bus/directory.h"
#include "services/bus/owner.h"
#include "services/bus/participant.h"
#include "services/core/file.h"
#include "services/core/identity.h"
#include "services/core/result.h"
#include "services/relay/kept_checkpoints.h"

namespace etude::relay {

struct RelayOptions {
  Path folder;  ///< of this relay alone, see kept_checkpoints.h
  /// Which of the run's checkpoints are kept, such as bus::AcceptSigned; called by one thread. Empty: all. What is kept
  /// already is judged, without its bytes, as the relay is opened: what is kCorrupt is forgotten.
  std::function<Status(const bus::PublishedBlob&)> accept;
  /// For so long nobody else must have had what is kept before it is offered: longer than it takes to discover a
  /// trainer that is there, or to hear its next checkpoint out.
  std::chrono::milliseconds patience{2'000};
  std::string user = {};  ///< whose run it is; "": as the folder says
};

/// Of one run. One thread at a time; the participant must outlive it.
class Relay {
 public:
  /// Is in the directory (kind relay) for as long as it lives.
  /// @error as KeptCheckpoints::Open and Forget; of the bus
  static Result<Relay> Open(const bus::Participant& participant, const bus::Owner& run, const RelayOptions& options);
  Relay(Relay&&) noexcept;
  Relay& operator=(Relay&&) noexcept;
  ~Relay();

  /// Takes what has come within `timeout`, and begins or ends to offer what is kept. What goes wrong is logged and
  /// tried again: a full disk, a bus that does not take it.
  void Step(std::chrono::nanoseconds timeout);
  /// The channels whose checkpoint it offers now.
  std::vector<std::string> offered() const;

 private:
  struct Impl;
  explicit Relay(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Whether `kept` goes on: the selector means it, and no next run of its own user has taken its place; another user's
/// does not, also where this process was started again.
bool GoesOn(bus::Directory& directory, const Selector& selector, const std::optional<KeptOwner>& kept);

/// Relays a run until `stopping`, which is asked several times a second. With its name alone: the run of that name
/// which is there, else the one that the folder is of; and when another one of the name and the same user (where the
/// run has gone already: this process's) has taken its place, that one; where several have, the first goes on until one
/// of them is left.
/// @error kInvalidArgument: the name means several runs as it begins, or the folder is of one of another name; as
/// Relay::Open
Status RelayRuns(const bus::Participant& participant, const Selector& selector, const RelayOptions& options,
                 const std::function<bool()>& stopping);

}  // namespace etude::relay
