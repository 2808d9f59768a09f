// SPDX-License-Identifier: Apache-2.0
#include "services/bus/topic.h"

#include <fmt/format.h>

#include "services/bus/typed.h"
#include "services/core/clock.h"

namespace etude::bus {

template <class Message>
struct Writer<Message>::Impl {
  Endpoint endpoint;
  Waiter waiter;
};

template <class Message>
Writer<Message>::Writer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
template <class Message>
Writer<Message>::Writer(Writer&&) noexcept = default;
template <class Message>
Writer<Message>& Writer<Message>::operator=(Writer&&) noexcept = default;
template <class Message>
Writer<Message>::~Writer() = default;

template <class Message>
Result<Writer<Message>> Writer<Message>::Open(const Participant& participant, const std::string& partition) {
  auto impl = std::make_unique<Impl>();
  ETUDE_ASSIGN_OR_RETURN(impl->endpoint, OpenWriterOf<Message>(participant, partition));
  ETUDE_RETURN_IF_ERROR(impl->waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddMatched(impl->endpoint));
  return Writer(std::move(impl));
}

template <class Message>
Status Writer<Message>::Write(const Message& message) {
  return WriteMessage(impl_->endpoint, message);
}

template <class Message>
Status Writer<Message>::Dispose(const Message& message) {
  ETUDE_ASSIGN_OR_RETURN(const auto wire, Encode(message));
  const dds_return_t code = dds_dispose(impl_->endpoint.get(), &wire);
  if (code == DDS_RETCODE_OK) return {};
  return Fail(DdsError(code, fmt::format("dispose on topic '{}'", Traits<Message>::kTopic)));
}

template <class Message>
int Writer<Message>::matched_readers() const {
  return MatchedReaders(impl_->endpoint);
}

template <class Message>
bool Writer<Message>::WaitForReaders(int count, std::chrono::nanoseconds timeout) const {
  const Stopwatch watch;
  const double timeout_s = std::chrono::duration<double>(timeout).count();
  while (matched_readers() < count) {
    const double left_s = timeout_s - watch.Seconds();
    if (left_s <= 0) return false;
    const bool changed =
        impl_->waiter.Wait(std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(left_s)));
    if (!changed) return matched_readers() >= count;
  }
  return true;
}

template <class Message>
struct Reader<Message>::Impl {
  Endpoint endpoint;
  Waiter waiter;
  std::uint64_t malformed = 0;
};

template <class Message>
Reader<Message>::Reader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
template <class Message>
Reader<Message>::Reader(Reader&&) noexcept = default;
template <class Message>
Reader<Message>& Reader<Message>::operator=(Reader&&) noexcept = default;
template <class Message>
Reader<Message>::~Reader() = default;

template <class Message>
Result<Reader<Message>> Reader<Message>::Open(const Participant& participant, const std::string& partition) {
  auto impl = std::make_unique<Impl>();
  ETUDE_ASSIGN_OR_RETURN(impl->endpoint, OpenReaderOf<Message>(participant, partition));
  ETUDE_RETURN_IF_ERROR(impl->waiter.Open(participant));
  ETUDE_RETURN_IF_ERROR(impl->waiter.AddReader(impl->endpoint));
  return Reader(std::move(impl));
}

template <class Message>
std::vector<Message> Reader<Message>::Take(int at_most) {
  return TakeMessages<Message>(impl_->endpoint, at_most, impl_->malformed);
}

template <class Message>
std::vector<Message> Reader<Message>::Live() {
  return ReadLive<Message>(impl_->endpoint, impl_->malformed);
}

template <class Message>
bool Reader<Message>::Wait(std::chrono::nanoseconds timeout) {
  return impl_->waiter.Wait(timeout);
}

template <class Message>
int Reader<Message>::matched_writers() const {
  return MatchedWriters(impl_->endpoint);
}

template <class Message>
std::uint64_t Reader<Message>::malformed() const {
  return impl_->malformed;
}

#define ETUDE_INSTANTIATE(Name) \
  template class Writer<Name>;  \
  template class Reader<Name>;

ETUDE_INSTANTIATE(Presence)
ETUDE_INSTANTIATE(CampaignAnnouncement)
ETUDE_INSTANTIATE(WorkRequest)
ETUDE_INSTANTIATE(Lease)
ETUDE_INSTANTIATE(WorkerStatus)
ETUDE_INSTANTIATE(AttemptReport)
ETUDE_INSTANTIATE(ValidationErrors)
ETUDE_INSTANTIATE(CampaignStatus)
ETUDE_INSTANTIATE(CampaignControl)
ETUDE_INSTANTIATE(BlobManifest)
ETUDE_INSTANTIATE(BlobChunk)
ETUDE_INSTANTIATE(BlobAck)
ETUDE_INSTANTIATE(Observation)
ETUDE_INSTANTIATE(Action)
ETUDE_INSTANTIATE(InsightWish)
ETUDE_INSTANTIATE(Insight)
ETUDE_INSTANTIATE(PolicyStatus)
ETUDE_INSTANTIATE(PlayCommand)
ETUDE_INSTANTIATE(PlayState)
ETUDE_INSTANTIATE(PlayFrame)
ETUDE_INSTANTIATE(ProcessStatus)
ETUDE_INSTANTIATE(ProcessEvent)
ETUDE_INSTANTIATE(TrainStatus)

#undef ETUDE_INSTANTIATE

}  // namespace etude::bus
