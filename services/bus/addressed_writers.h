// SPDX-License-Identifier: Apache-2.0
// Writers of what is meant for one address, an identity's or a process's: leases, acknowledgements, actions. Each has a
// partition of its own (PartitionOfAddress), so that what one is told costs a datagram to that one, and is not read by
// others.
//
//   AddressedWriters<Lease> leases(participant, owner.partition());
//   leases.Write(request.host, lease);   // opens the writer when it is first heard of
//   leases.Tidy();                       // now and then
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/result.h"

namespace etude::bus {

struct AddressedWritersOptions {
  std::size_t most_addresses = 4096;       ///< addresses; beyond them those that are not there any more make room
  std::size_t most_waiting = 4096;         ///< messages to those whose readers are not found yet, of all together
  std::size_t most_waiting_each = 64;      ///< of one address: then the oldest goes
  std::chrono::milliseconds wait{5'000};   ///< for the readers of an address that is new; then its messages are dropped
  std::chrono::milliseconds gone{30'000};  ///< one without readers, and to which nothing was said, has gone
};

/// One writer for each address that it was asked to write to. Instantiated for Lease, BlobAck and Action. Thread-safe;
/// what two threads write at once to a new one may come in any order.
template <class Message>
class AddressedWriters {
 public:
  /// @param partition  whose peers they are
  AddressedWriters(const Participant& participant, const std::string& partition,
                   const AddressedWritersOptions& options = {});
  AddressedWriters(AddressedWriters&&) noexcept;
  AddressedWriters& operator=(AddressedWriters&&) noexcept;
  ~AddressedWriters();

  /// To who reads in the partition of `address`. To one that is new it is kept until its reader is found: Tidy sends it
  /// then. `address` may be anybody's word; "" is the partition itself, for peers that do not name theirs.
  /// @error kInvalidArgument: `address` is no plain name; kExhausted: there are too many; kTimeout as Writer::Write
  Status Write(const std::string& address, const Message& message);
  /// Sends what waits for those that are found by now, and forgets those that have gone.
  void Tidy();
  bool waiting() const;           ///< for those that are not found yet: call Tidy soon
  std::size_t addresses() const;  ///< that are known now

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::bus
