// SPDX-License-Identifier: Apache-2.0
// Typed writers and readers of the messages in messages.h.
//
//   ETUDE_ASSIGN_OR_RETURN(auto writer, Writer<WorkerStatus>::Open(participant, campaign));
//   writer.Write(status);
//   ETUDE_ASSIGN_OR_RETURN(auto reader, Reader<Lease>::Open(participant, campaign));
//   while (reader.Wait(100ms)) for (auto& lease : reader.Take()) ...
//
// `partition` keeps campaigns and runs apart (DDS partition QoS). QoS is fixed per message type
// (proto/README.md). Instantiated in services/bus for every struct of messages.h.
// Thread safety: one thread at a time per Writer and per Reader.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/result.h"

namespace etude::bus {

template <class Message>
class Writer {
 public:
  static Result<Writer> Open(const Participant& participant, const std::string& partition);
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;
  ~Writer();

  /// @error kTimeout when a reliable reader does not drain within the QoS's blocking time.
  Status Write(const Message& message);
  /// Ends the instance of `message`'s key (transient-local topics): late joiners no longer see it.
  Status Dispose(const Message& message);
  int matched_readers() const;
  /// Waits until at least `count` readers are matched; false on timeout or stop request.
  bool WaitForReaders(int count, std::chrono::nanoseconds timeout) const;

 private:
  struct Impl;
  explicit Writer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

template <class Message>
class Reader {
 public:
  static Result<Reader> Open(const Participant& participant, const std::string& partition);
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;
  ~Reader();

  /// Everything received and not yet taken, oldest first. Malformed samples are dropped and counted.
  std::vector<Message> Take(int at_most = 256);
  /// The newest of every key whose writer is still there, taken or not, 256 at most; for topics of QoS "state". A
  /// writer that ended counts as gone at once, one that was killed after DDS's lease (10 s).
  std::vector<Message> Live();
  /// Blocks until data is there, `timeout` is over, or a stop is requested; true when data is there.
  bool Wait(std::chrono::nanoseconds timeout);
  int matched_writers() const;
  /// Samples dropped because a field was out of its bounds.
  std::uint64_t malformed() const;

 private:
  struct Impl;
  explicit Reader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
