// SPDX-License-Identifier: Apache-2.0
#include "services/bus/host_writers.h"

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
struct HostWriters<Message>::Impl {
  using Time = MonotonicClock::time_point;
  // A volatile writer's first words are lost where its readers are not found yet: under security that takes a while.
  struct Host {
    std::shared_ptr<const Endpoint> writer;
    Time opened{}, used{};
    bool met = false;  // its readers were found once, or not in time
    std::vector<Message> waiting;
  };
  // What is to be written, once the mutex is free: a host that does not take it holds up no others.
  struct Due {
    std::shared_ptr<const Endpoint> writer;
    std::vector<Message> messages;
  };

  Participant participant;
  std::string partition;
  HostWritersOptions options;
  mutable Mutex mutex;
  std::map<std::string, Host> hosts ETUDE_GUARDED_BY(mutex) = {};
  std::size_t waiting ETUDE_GUARDED_BY(mutex) = 0;  // messages
  Time look_again ETUDE_GUARDED_BY(mutex) = {};

  Result<Host*> Find(const std::string& name, Time now) ETUDE_REQUIRES(mutex);
  Status MakeRoom(Time now) ETUDE_REQUIRES(mutex);
  Due Meet(Host& host, Time now) ETUDE_REQUIRES(mutex);
  void ForgetTheGone(Time now) ETUDE_REQUIRES(mutex);
  void Forget(typename std::map<std::string, Host>::iterator host) ETUDE_REQUIRES(mutex);
  static Status WriteAll(const Due& due);
};

template <class Message>
void HostWriters<Message>::Impl::Forget(typename std::map<std::string, Host>::iterator host) {
  waiting -= host->second.waiting.size();
  hosts.erase(host);
}

// Of those that nobody reads the one that was written to longest ago goes.
template <class Message>
Status HostWriters<Message>::Impl::MakeRoom(Time now) {
  auto oldest = hosts.end();
  for (auto host = hosts.begin(); host != hosts.end(); ++host) {
    if (MatchedReaders(*host->second.writer) > 0)
      host->second.used = now;
    else if (oldest == hosts.end() || host->second.used < oldest->second.used)
      oldest = host;
  }
  if (oldest == hosts.end())
    return Fail(Code::kExhausted, fmt::format("write on topic '{}' in partition '{}': {} hosts are there, no more fit",
                                              Traits<Message>::kTopic, partition, hosts.size()));
  Forget(oldest);
  return {};
}

template <class Message>
Result<typename HostWriters<Message>::Impl::Host*> HostWriters<Message>::Impl::Find(const std::string& name, Time now) {
  const auto known = hosts.find(name);
  if (known != hosts.end()) return &known->second;
  if (!name.empty() && !IsPlainName(name))
    return Fail(Code::kInvalidArgument, fmt::format("write on topic '{}' to host '{:.64}': a name of a-z, 0-9, _ and -",
                                                    Traits<Message>::kTopic, name));
  if (hosts.size() >= options.most_hosts) ETUDE_RETURN_IF_ERROR(MakeRoom(now));
  const std::string own = name.empty() ? partition : PartitionOfAddress(partition, name);
  ETUDE_ASSIGN_OR_RETURN(auto writer, OpenWriterOf<Message>(participant, own));
  Host& host = hosts[name];
  host.writer = std::make_shared<const Endpoint>(std::move(writer));
  host.opened = now;
  return &host;
}

// What waits for `host` where its readers are found, or were not in time: then nobody reads it any more.
template <class Message>
typename HostWriters<Message>::Impl::Due HostWriters<Message>::Impl::Meet(Host& host, Time now) {
  if (!host.met) host.met = MatchedReaders(*host.writer) > 0 || now - host.opened > options.wait;
  if (!host.met) return {};
  waiting -= host.waiting.size();
  return {host.writer, std::exchange(host.waiting, {})};
}

template <class Message>
void HostWriters<Message>::Impl::ForgetTheGone(Time now) {
  look_again = now + std::min<std::chrono::nanoseconds>(kLookForTheGone, options.gone);
  for (auto host = hosts.begin(); host != hosts.end();) {
    const auto next = std::next(host);
    if (MatchedReaders(*host->second.writer) > 0)
      host->second.used = now;
    else if ((host->second.met || host->second.waiting.empty()) && now - host->second.used > options.gone)
      Forget(host);
    host = next;
  }
}

template <class Message>
Status HostWriters<Message>::Impl::WriteAll(const Due& due) {
  Status status;
  for (const Message& message : due.messages)
    if (Status written = WriteMessage(*due.writer, message); !written) status = std::move(written);
  return status;
}

template <class Message>
HostWriters<Message>::HostWriters(const Participant& participant, const std::string& partition,
                                  const HostWritersOptions& options)
    : impl_(new Impl{.participant = participant.Share(), .partition = partition, .options = options, .mutex = {}}) {}
template <class Message>
HostWriters<Message>::HostWriters(HostWriters&&) noexcept = default;
template <class Message>
HostWriters<Message>& HostWriters<Message>::operator=(HostWriters&&) noexcept = default;
template <class Message>
HostWriters<Message>::~HostWriters() = default;

template <class Message>
Status HostWriters<Message>::Write(const std::string& name, const Message& message) {
  typename Impl::Due due;
  {
    const MutexLock lock(impl_->mutex);
    const auto now = MonotonicClock::now();
    ETUDE_ASSIGN_OR_RETURN(typename Impl::Host * host, impl_->Find(name, now));
    host->used = now;
    due = impl_->Meet(*host, now);
    if (!due.writer) {
      // it is asked for again and again: what was said before that is old
      if (host->waiting.size() >= impl_->options.most_waiting_each) {
        host->waiting.erase(host->waiting.begin());
        --impl_->waiting;
      }
      if (impl_->waiting >= impl_->options.most_waiting)
        return Fail(Code::kExhausted,
                    fmt::format("write on topic '{}' to host '{}': its reader is not found yet, and {} messages wait",
                                Traits<Message>::kTopic, name, impl_->waiting));
      host->waiting.push_back(message);
      ++impl_->waiting;
      return {};
    }
  }
  if (due.messages.empty()) return WriteMessage(*due.writer, message);
  due.messages.push_back(message);
  return Impl::WriteAll(due);
}

template <class Message>
void HostWriters<Message>::Tidy() {
  std::vector<typename Impl::Due> all;
  {
    const MutexLock lock(impl_->mutex);
    const auto now = MonotonicClock::now();
    if (now >= impl_->look_again) impl_->ForgetTheGone(now);
    if (impl_->waiting == 0) return;
    for (auto& [name, host] : impl_->hosts)
      if (!host.waiting.empty()) all.push_back(impl_->Meet(host, now));
  }
  for (const auto& due : all)
    if (const Status written = Impl::WriteAll(due); !written) Log().debug("{}", written.error().message);
}

template <class Message>
bool HostWriters<Message>::waiting() const {
  const MutexLock lock(impl_->mutex);
  return impl_->waiting > 0;
}

template <class Message>
std::size_t HostWriters<Message>::hosts() const {
  const MutexLock lock(impl_->mutex);
  return impl_->hosts.size();
}

template class HostWriters<Lease>;
template class HostWriters<BlobAck>;
template class HostWriters<Action>;

}  // namespace etude::bus
