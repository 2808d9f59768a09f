// SPDX-License-Identifier: Apache-2.0
// Writing and taking messages at an endpoint. Internal to services/bus.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "services/bus/participant_state.h"
#include "services/bus/wire.h"

namespace etude::bus {

/// The wire struct borrows the message's memory.
/// @param bytes  gets the size of its fields
template <class Message>
Result<typename Traits<Message>::Wire> Encode(const Message& message, std::uint64_t* bytes = nullptr) {
  typename Traits<Message>::Wire wire{};
  Encoder encoder;
  Fields(encoder, message, wire);
  if (bytes) *bytes = encoder.bytes();
  std::string problem = encoder.problem();
  if (problem.empty() && !IsSound(message)) problem = "its sizes contradict each other";
  if (!problem.empty()) {
    return Fail(Code::kInvalidArgument, fmt::format("write on topic '{}': {}", Traits<Message>::kTopic, problem));
  }
  return wire;
}

template <class Message>
Status WriteMessage(const Endpoint& writer, const Message& message) {
  std::uint64_t bytes = 0;
  ETUDE_ASSIGN_OR_RETURN(const auto wire, Encode(message, &bytes));
  const dds_return_t code = dds_write(writer.get(), &wire);
  if (code == DDS_RETCODE_OK) {
    writer.traffic->Add(bytes);
    return {};
  }
  return Fail(DdsError(code, fmt::format("write on topic '{}'", Traits<Message>::kTopic)));
}

template <class Message>
void DecodeAll(void* const* samples, const dds_sample_info_t* infos, int count, std::vector<Message>& messages,
               std::uint64_t& malformed, Traffic* traffic = nullptr) {
  for (int i = 0; i < count; ++i) {
    if (!infos[i].valid_data) continue;  // an instance's end
    Message message;
    Decoder decoder;
    Fields(decoder, message, *static_cast<const typename Traits<Message>::Wire*>(samples[i]));
    if (traffic) traffic->Add(decoder.bytes());
    if (decoder.ok() && IsSound(message))
      messages.push_back(std::move(message));
    else
      TellMalformed(Traits<Message>::kTopic, ++malformed);
  }
}

/// Samples that a reader lends at most. Cyclone 0.10 keeps the largest loan of a reader and fills in a pointer for each
/// of its samples, however few are asked for: every call needs room for as many.
inline constexpr int kMostLent = 256;

/// Forgets instances whose writers have gone: a topic that is read and never taken would keep each that ever was.
inline void DropEnded(const Endpoint& reader) {
  constexpr std::uint32_t kEnded = DDS_ANY_SAMPLE_STATE | DDS_ANY_VIEW_STATE | DDS_NOT_ALIVE_DISPOSED_INSTANCE_STATE |
                                   DDS_NOT_ALIVE_NO_WRITERS_INSTANCE_STATE;
  void* samples[kMostLent] = {};
  dds_sample_info_t infos[kMostLent];
  const dds_return_t count = dds_take_mask(reader.get(), samples, infos, kMostLent, kMostLent, kEnded);
  if (count > 0) dds_return_loan(reader.get(), samples, count);
}

/// What the reader holds of instances that are alive, kMostLent of them at most; it goes on holding it.
template <class Message>
std::vector<Message> ReadLive(const Endpoint& reader, std::uint64_t& malformed) {
  DropEnded(reader);
  void* samples[kMostLent] = {};
  dds_sample_info_t infos[kMostLent];
  std::vector<Message> messages;
  constexpr std::uint32_t kAlive = DDS_ANY_SAMPLE_STATE | DDS_ANY_VIEW_STATE | DDS_ALIVE_INSTANCE_STATE;
  const dds_return_t count = dds_read_mask(reader.get(), samples, infos, kMostLent, kMostLent, kAlive);
  if (count <= 0) return messages;
  DecodeAll(samples, infos, count, messages, malformed);
  dds_return_loan(reader.get(), samples, count);
  return messages;
}

template <class Message>
std::vector<Message> TakeMessages(const Endpoint& reader, int at_most, std::uint64_t& malformed) {
  constexpr int kBatch = 32;
  std::vector<Message> messages;
  while (static_cast<int>(messages.size()) < at_most) {
    void* samples[kMostLent] = {};
    dds_sample_info_t infos[kBatch];
    const int wanted = std::min(kBatch, at_most - static_cast<int>(messages.size()));
    const dds_return_t count = dds_take(reader.get(), samples, infos, kBatch, static_cast<std::uint32_t>(wanted));
    if (count <= 0) break;
    DecodeAll(samples, infos, count, messages, malformed, reader.traffic.get());
    dds_return_loan(reader.get(), samples, count);
  }
  return messages;
}

template <class Message>
Result<Endpoint> OpenWriterOf(const Participant& participant, const std::string& partition) {
  using T = Traits<Message>;
  return OpenWriter(participant, partition, T::descriptor(), T::kTopic, T::kQos);
}

template <class Message>
Result<Endpoint> OpenReaderOf(const Participant& participant, const std::string& partition) {
  using T = Traits<Message>;
  return OpenReader(participant, partition, T::descriptor(), T::kTopic, T::kQos);
}

}  // namespace etude::bus
