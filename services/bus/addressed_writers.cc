// SPDX-License-Identifier: Apache-2.0
#include "services/bus/addressed_writers.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "services/bus/owner.h"
#include "services/bus/typed.h"
#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"

namespace etude::bus {

namespace {

constexpr std::chrono::seconds kLookForTheGone{5};

}  // namespace

template <class Message>
struct AddressedWriters<Message>::Impl {
  using Time = MonotonicClock::time_point;
  // A volatile writer's first words are lost where its readers are not found yet: under security that takes a while.
  struct Addressee {
    std::shared_ptr<const Endpoint> writer;
    Time opened{}, used{};
    bool met = false;  // its readers were found once, or not in time
    std::vector<Message> waiting;
  };
  // What is to be written, once the mutex is free: a addressee that does not take it holds up no others.
  struct Due {
    std::shared_ptr<const Endpoint> writer;
    std::vector<Message> messages;
  };

  Participant participant;
  std::string partition;
  AddressedWritersOptions options;
  mutable Mutex mutex;
  std::map<std::string, Addressee> addressees ETUDE_GUARDED_BY(mutex) = {};
  std::size_t waiting ETUDE_GUARDED_BY(mutex) = 0;  // messages
  Time look_again ETUDE_GUARDED_BY(mutex) = {};

  Result<Addressee*> Find(const std::string& name, Time now) ETUDE_REQUIRES(mutex);
  Status MakeRoom(Time now) ETUDE_REQUIRES(mutex);
  Due Meet(Addressee& addressee, Time now) ETUDE_REQUIRES(mutex);
  void ForgetTheGone(Time now) ETUDE_REQUIRES(mutex);
  void Forget(typename std::map<std::string, Addressee>::iterator addressee) ETUDE_REQUIRES(mutex);
  static Status WriteAll(const Due& due);
};

template <class Message>
void AddressedWriters<Message>::Impl::Forget(typename std::map<std::string, Addressee>::iterator addressee) {
  waiting -= addressee->second.waiting.size();
  addressees.erase(addressee);
}

// Of those that nobody reads the one that was written to longest ago goes.
template <class Message>
Status AddressedWriters<Message>::Impl::MakeRoom(Time now) {
  auto oldest = addressees.end();
  for (auto addressee = addressees.begin(); addressee != addressees.end(); ++addressee) {
    if (MatchedReaders(*addressee->second.writer) > 0)
      addressee->second.used = now;
    else if (oldest == addressees.end() || addressee->second.used < oldest->second.used)
      oldest = addressee;
  }
  if (oldest == addressees.end())
    return Fail(Code::kExhausted,
                fmt::format("write on topic '{}' in partition '{}': {} addresses are there, no more fit",
                            Traits<Message>::kTopic, partition, addressees.size()));
  Forget(oldest);
  return {};
}

template <class Message>
Result<typename AddressedWriters<Message>::Impl::Addressee*> AddressedWriters<Message>::Impl::Find(
    const std::string& name, Time now) {
  const auto known = addressees.find(name);
  if (known != addressees.end()) return &known->second;
  if (!name.empty() && !IsPlainName(name))
    return Fail(Code::kInvalidArgument, fmt::format("write on topic '{}' to '{:.64}': a name of a-z, 0-9, _ and -",
                                                    Traits<Message>::kTopic, name));
  if (addressees.size() >= options.most_addresses) ETUDE_RETURN_IF_ERROR(MakeRoom(now));
  const std::string own = name.empty() ? partition : PartitionOfAddress(partition, name);
  ETUDE_ASSIGN_OR_RETURN(auto writer, OpenWriterOf<Message>(participant, own));
  Addressee& addressee = addressees[name];
  addressee.writer = std::make_shared<const Endpoint>(std::move(writer));
  addressee.opened = now;
  return &addressee;
}

// What waits for `addressee` where its readers are found, or were not in time: then nobody reads it any more.
template <class Message>
typename AddressedWriters<Message>::Impl::Due AddressedWriters<Message>::Impl::Meet(Addressee& addressee, Time now) {
  if (!addressee.met) addressee.met = MatchedReaders(*addressee.writer) > 0 || now - addressee.opened > options.wait;
  if (!addressee.met) return {};
  waiting -= addressee.waiting.size();
  return {addressee.writer, std::exchange(addressee.waiting, {})};
}

template <class Message>
void AddressedWriters<Message>::Impl::ForgetTheGone(Time now) {
  look_again = now + std::min<std::chrono::nanoseconds>(kLookForTheGone, options.gone);
  for (auto addressee = addressees.begin(); addressee != addressees.end();) {
    const auto next = std::next(addressee);
    if (MatchedReaders(*addressee->second.writer) > 0)
      addressee->second.used = now;
    else if ((addressee->second.met || addressee->second.waiting.empty()) &&
             now - addressee->second.used > options.gone)
      Forget(addressee);
    addressee = next;
  }
}

template <class Message>
Status AddressedWriters<Message>::Impl::WriteAll(const Due& due) {
  Status status;
  for (const Message& message : due.messages)
    if (Status written = WriteMessage(*due.writer, message); !written) status = std::move(written);
  return status;
}

template <class Message>
AddressedWriters<Message>::AddressedWriters(const Participant& participant, const std::string& partition,
                                            const AddressedWritersOptions& options)
    : impl_(new Impl{.participant = participant.Share(), .partition = partition, .options = options, .mutex = {}}) {}
template <class Message>
AddressedWriters<Message>::AddressedWriters(AddressedWriters&&) noexcept = default;
template <class Message>
AddressedWriters<Message>& AddressedWriters<Message>::operator=(AddressedWriters&&) noexcept = default;
template <class Message>
AddressedWriters<Message>::~AddressedWriters() = default;

template <class Message>
Status AddressedWriters<Message>::Write(const std::string& name, const Message& message) {
  typename Impl::Due due;
  {
    const MutexLock lock(impl_->mutex);
    const auto now = MonotonicClock::now();
    ETUDE_ASSIGN_OR_RETURN(typename Impl::Addressee * addressee, impl_->Find(name, now));
    addressee->used = now;
    due = impl_->Meet(*addressee, now);
    if (!due.writer) {
      // it is asked for again and again: what was said before that is old
      if (addressee->waiting.size() >= impl_->options.most_waiting_each) {
        addressee->waiting.erase(addressee->waiting.begin());
        --impl_->waiting;
      }
      if (impl_->waiting >= impl_->options.most_waiting)
        return Fail(Code::kExhausted,
                    fmt::format("write on topic '{}' to '{}': its reader is not found yet, and {} messages wait",
                                Traits<Message>::kTopic, name, impl_->waiting));
      addressee->waiting.push_back(message);
      ++impl_->waiting;
      return {};
    }
  }
  if (due.messages.empty()) return WriteMessage(*due.writer, message);
  due.messages.push_back(message);
  return Impl::WriteAll(due);
}

template <class Message>
void AddressedWriters<Message>::Tidy() {
  std::vector<typename Impl::Due> all;
  {
    const MutexLock lock(impl_->mutex);
    const auto now = MonotonicClock::now();
    if (now >= impl_->look_again) impl_->ForgetTheGone(now);
    if (impl_->waiting == 0) return;
    for (auto& [name, addressee] : impl_->addressees)
      if (!addressee.waiting.empty()) all.push_back(impl_->Meet(addressee, now));
  }
  for (const auto& due : all)
    if (const Status written = Impl::WriteAll(due); !written) Log().debug("{}", written.error().message);
}

template <class Message>
bool AddressedWriters<Message>::waiting() const {
  const MutexLock lock(impl_->mutex);
  return impl_->waiting > 0;
}

template <class Message>
std::size_t AddressedWriters<Message>::addresses() const {
  const MutexLock lock(impl_->mutex);
  return impl_->addressees.size();
}

template class AddressedWriters<Lease>;
template class AddressedWriters<BlobAck>;
template class AddressedWriters<Action>;

}  // namespace etude::bus
