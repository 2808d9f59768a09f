// SPDX-License-Identifier: Apache-2.0
// Play sessions on the bus as those see them that talk to them: the command line, the dashboard.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/core/result.h"

namespace etude::play {

/// A session that was not heard for this long is not there any more.
inline constexpr std::chrono::seconds kSilent{5};

struct HeardState {
  bus::PlayState state;
  MonotonicClock::time_point heard{};
};

/// Reads states, sends commands. Not thread-safe.
class Client {
 public:
  /// @param participant  must outlive the client. @error of the bus
  static Result<Client> Open(const bus::Participant& participant);
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;
  ~Client();

  /// Takes what came, waiting up to `timeout` for something; forgets who is silent or has ended.
  const std::map<std::string, HeardState>& Listen(std::chrono::nanoseconds timeout);
  /// The state of a session, which need not be there yet. @error kNotFound: not heard within `timeout`
  Result<bus::PlayState> Find(const std::string& session, std::chrono::nanoseconds timeout);

  /// Says it again until the session answers; once, and without waiting, when a stop is requested. @returns its state
  /// then
  /// @error kInvalidArgument: it refused, in its words; kUnavailable: no answer within `timeout`
  Result<bus::PlayState> Command(const std::string& session, bus::PlayAction action, const OrderedJson& arguments,
                                 std::chrono::nanoseconds timeout = std::chrono::seconds(15));

 private:
  struct Impl;
  explicit Client(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Pictures of one session, the newest counts. Not thread-safe.
class Frames {
 public:
  /// @error kInvalidArgument: not the name of a session; of the bus
  static Result<Frames> Open(const bus::Participant& participant, const std::string& session);
  Frames(Frames&&) noexcept;
  Frames& operator=(Frames&&) noexcept;
  ~Frames();

  /// One that came since the last call, waiting up to `timeout` for it.
  std::optional<bus::PlayFrame> Take(std::chrono::nanoseconds timeout);

 private:
  struct Impl;
  explicit Frames(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Whether this may be a session's name: letters, digits, _ and -, 1 to 64 of them.
bool IsSessionName(const std::string& name);
/// The DDS partition of a session's frames. @pre IsSessionName
std::string FramePartition(const std::string& session);
/// What a session's observations are called, for the policy that it asks and for whoever looks into that.
std::string PolicySession(const std::string& session);
/// "nudge" and the like, as commands are called by people. @error kInvalidArgument: an unknown one
Result<bus::PlayAction> ActionOf(const std::string& name);

}  // namespace etude::play
