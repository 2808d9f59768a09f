// SPDX-License-Identifier: Apache-2.0
// Between the structs of messages.h and idlc's C structs. One field list a message serves both
// directions. Internal to services/bus.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "blob.h"
#include "campaign.h"
#include "play.h"
#include "policy.h"
#include "presence.h"
#include "process.h"
#include "services/bus/access.h"
#include "services/bus/messages.h"
#include "services/bus/qos.h"
#include "train.h"

namespace etude::bus {

inline constexpr std::size_t kMaxText = 4u << 20;  ///< bytes of a text without a bound in the IDL

/// Wire type, descriptor, topic name and QoS of a message.
template <class Message>
struct Traits;

/// Fills a C struct that borrows the message's memory: it must not be freed with dds_sample_free, and
/// the message must outlive it.
class Encoder {
 public:
  template <std::size_t kSize>
  void operator()(const char* name, const std::string& from, char (&to)[kSize]) {
    if (!CheckText(name, from, kSize - 1)) return;
    std::memcpy(to, from.c_str(), from.size() + 1);
    bytes_ += from.size();
  }
  void operator()(const char* name, const std::string& from, char*& to) {
    if (CheckText(name, from, kMaxText)) to = const_cast<char*>(from.c_str());
    bytes_ += from.size();
  }
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const char*, const T& from, T& to) {
    to = from;
    bytes_ += sizeof(T);
  }
  template <class E>
  requires std::is_enum_v<E>
  void operator()(const char*, const E& from, std::uint8_t& to, E) {
    to = static_cast<std::uint8_t>(from);
    ++bytes_;
  }
  template <class T, class Sequence>
  void operator()(const char* name, const std::vector<T>& from, Sequence& to, std::size_t bound) {
    if (from.size() > bound) return Refuse(name, from.size(), bound);
    to._maximum = to._length = static_cast<std::uint32_t>(from.size());
    to._buffer = const_cast<T*>(from.data());
    to._release = false;
    bytes_ += from.size() * sizeof(T);
  }
  std::uint64_t bytes() const { return bytes_; }  ///< of the fields
  /// Empty, or what does not fit.
  const std::string& problem() const { return problem_; }

 private:
  bool CheckText(const char* name, const std::string& text, std::size_t bound);
  void Refuse(const char* name, std::size_t size, std::size_t bound);
  std::string problem_;
  std::uint64_t bytes_ = 0;
};

/// Copies a C struct into a message and checks every length.
class Decoder {
 public:
  template <std::size_t kSize>
  void operator()(const char*, std::string& to, const char (&from)[kSize]) {
    const std::size_t size = ::strnlen(from, kSize);
    bytes_ += size;
    if (size == kSize)
      ok_ = false;
    else
      to.assign(from, size);
  }
  template <class Pointer>
  requires std::is_pointer_v<Pointer>
  void operator()(const char*, std::string& to, const Pointer& from) {
    if (from == nullptr) return to.clear();
    const std::size_t size = ::strnlen(from, kMaxText + 1);
    bytes_ += size;
    if (size > kMaxText)
      ok_ = false;
    else
      to.assign(from, size);
  }
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const char*, T& to, const T& from) {
    to = from;
    bytes_ += sizeof(T);
  }
  template <class E>
  requires std::is_enum_v<E>
  void operator()(const char*, E& to, const std::uint8_t& from, E last) {
    ++bytes_;
    if (from > static_cast<std::uint8_t>(last))
      ok_ = false;
    else
      to = static_cast<E>(from);
  }
  template <class T, class Sequence>
  void operator()(const char*, std::vector<T>& to, const Sequence& from, std::size_t bound) {
    if (from._length > bound || (from._length > 0 && from._buffer == nullptr)) {
      ok_ = false;
      return;
    }
    to.assign(from._buffer, from._buffer + from._length);
    bytes_ += from._length * sizeof(T);
    if constexpr (std::is_floating_point_v<T>) {
      for (const T value : to) ok_ = ok_ && std::isfinite(value);
    }
  }
  bool ok() const { return ok_; }
  std::uint64_t bytes() const { return bytes_; }  ///< of the fields

 private:
  bool ok_ = true;
  std::uint64_t bytes_ = 0;
};

/// The checks that go beyond a single field.
bool IsSound(const BlobManifest& manifest);
bool IsSound(const BlobChunk& chunk);
bool IsSound(const Observation& observation);
template <class Message>
bool IsSound(const Message&) {
  return true;
}

// The field lists. F is an Encoder (M const) or a Decoder.

#define ETUDE_FIELD(name) f(#name, m.name, w.name)
#define ETUDE_FIELD_UP_TO(name, bound) f(#name, m.name, w.name, bound)

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, Presence> {
  ETUDE_FIELD_UP_TO(kind, PresenceKind::kRelay);
  ETUDE_FIELD(id);
  ETUDE_FIELD(instance);
  ETUDE_FIELD(name);
  ETUDE_FIELD(wire);
  ETUDE_FIELD(content);
  ETUDE_FIELD(version);
  ETUDE_FIELD(host);
  ETUDE_FIELD(user);
  ETUDE_FIELD(folder);
  ETUDE_FIELD(since);
  ETUDE_FIELD(epoch);
  ETUDE_FIELD(shard);
  ETUDE_FIELD(shards);
  ETUDE_FIELD(spec_sha256);
  ETUDE_FIELD(folder_key);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, CampaignAnnouncement> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(spec_json);
  ETUDE_FIELD(spec_sha256);
  ETUDE_FIELD(version);
  ETUDE_FIELD(epoch);
  ETUDE_FIELD(complete);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(wire);
  ETUDE_FIELD(content);
  ETUDE_FIELD(policy_id);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, WorkRequest> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(worker);
  ETUDE_FIELD(request_id);
  ETUDE_FIELD(version);
  ETUDE_FIELD(files_sha256);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(spec_sha256);
  ETUDE_FIELD(wire);
  ETUDE_FIELD(content);
  ETUDE_FIELD(fingerprint_json);
  ETUDE_FIELD(host);
  ETUDE_FIELD(working_on);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, Lease> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(worker);
  ETUDE_FIELD(request_id);
  ETUDE_FIELD_UP_TO(kind, LeaseKind::kRefused);
  ETUDE_FIELD(index);
  ETUDE_FIELD(attempt);
  ETUDE_FIELD(token);
  ETUDE_FIELD(duration_ns);
  ETUDE_FIELD(reason);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(spec_sha256);
  ETUDE_FIELD(sampling_json);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, WorkerStatus> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(worker);
  ETUDE_FIELD(host);
  ETUDE_FIELD(phase);
  ETUDE_FIELD(index);
  ETUDE_FIELD(attempt);
  ETUDE_FIELD(token);
  ETUDE_FIELD(episodes);
  ETUDE_FIELD(failures);
  ETUDE_FIELD(steps_per_second);
  ETUDE_FIELD(frames_per_second);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(stage);
  ETUDE_FIELD(step);
  ETUDE_FIELD(last_outcome);
  ETUDE_FIELD(plan_s);
  ETUDE_FIELD(step_s);
  ETUDE_FIELD(render_s);
  ETUDE_FIELD(deflate_s);
  ETUDE_FIELD(send_s);
  ETUDE_FIELD_UP_TO(plan_histogram, kPlanBins);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, AttemptReport> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(worker);
  ETUDE_FIELD(index);
  ETUDE_FIELD(attempt);
  ETUDE_FIELD(token);
  ETUDE_FIELD(outcome);
  ETUDE_FIELD(details_json);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(spec_sha256);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, ValidationErrors> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(step);
  ETUDE_FIELD(errors_json);
  ETUDE_FIELD(campaign_id);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, CampaignStatus> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(committed);
  ETUDE_FIELD(total);
  ETUDE_FIELD(attempts);
  ETUDE_FIELD(given_up);
  ETUDE_FIELD(workers);
  ETUDE_FIELD(episodes_per_minute);
  ETUDE_FIELD(eta_s);
  ETUDE_FIELD(failures_json);
  ETUDE_FIELD(error);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD(state);
  ETUDE_FIELD(control_id);
  ETUDE_FIELD(control_refusal);
  ETUDE_FIELD(rechecked);
  ETUDE_FIELD(mismatched);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, CampaignControl> {
  ETUDE_FIELD(campaign);
  ETUDE_FIELD(control_id);
  ETUDE_FIELD(campaign_id);
  ETUDE_FIELD_UP_TO(action, ControlAction::kFilterKey);
  ETUDE_FIELD(host);
  ETUDE_FIELD(user);
  ETUDE_FIELD(filter_key);
  ETUDE_FIELD(episodes);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, BlobManifest> {
  ETUDE_FIELD(channel);
  ETUDE_FIELD(sender);
  ETUDE_FIELD(owner);
  ETUDE_FIELD(id);
  ETUDE_FIELD(size);
  ETUDE_FIELD(chunk_size);
  ETUDE_FIELD(chunk_count);
  ETUDE_FIELD_UP_TO(sha256, 32);
  ETUDE_FIELD(token);
  ETUDE_FIELD(meta_json);
  ETUDE_FIELD_UP_TO(data, 512 * 1024);
  ETUDE_FIELD(host);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, BlobChunk> {
  ETUDE_FIELD(channel);
  ETUDE_FIELD(sender);
  ETUDE_FIELD(id);
  ETUDE_FIELD(index);
  ETUDE_FIELD_UP_TO(data, 512 * 1024);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, BlobAck> {
  ETUDE_FIELD(channel);
  ETUDE_FIELD(sender);
  ETUDE_FIELD(id);
  ETUDE_FIELD_UP_TO(kind, AckKind::kMissing);
  ETUDE_FIELD(received);
  ETUDE_FIELD_UP_TO(missing, 1024);
  ETUDE_FIELD(reason);
  ETUDE_FIELD(owner);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, Observation> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(session);
  ETUDE_FIELD(request_id);
  ETUDE_FIELD(instruction);
  ETUDE_FIELD_UP_TO(joints, 64);
  ETUDE_FIELD(width);
  ETUDE_FIELD(height);
  ETUDE_FIELD_UP_TO(image, 16u << 20);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(robot);
  ETUDE_FIELD_UP_TO(intrinsics, 4);
  ETUDE_FIELD_UP_TO(camera_pose, 7);
  ETUDE_FIELD(host);
  ETUDE_FIELD(server);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, Action> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(session);
  ETUDE_FIELD(request_id);
  ETUDE_FIELD(error);
  ETUDE_FIELD(checkpoint_step);
  ETUDE_FIELD(checkpoint_sha256);
  ETUDE_FIELD_UP_TO(waypoints, 4096);
  ETUDE_FIELD(modules_json);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(rotation);
  ETUDE_FIELD_UP_TO(refusal, Refusal::kFailed);
  ETUDE_FIELD(server_p50_ms);
  ETUDE_FIELD(server_p99_ms);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, InsightWish> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(viewer);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(session);
  ETUDE_FIELD(seconds);
  ETUDE_FIELD(what_if_json);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, Insight> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(viewer);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(session);
  ETUDE_FIELD(request_id);
  ETUDE_FIELD(checkpoint_step);
  ETUDE_FIELD(checkpoint_sha256);
  ETUDE_FIELD(instruction);
  ETUDE_FIELD(error);
  ETUDE_FIELD(modules_json);
  ETUDE_FIELD(what_if_json);
  ETUDE_FIELD(attention_json);
  ETUDE_FIELD_UP_TO(attention, 4u << 20);
  ETUDE_FIELD(width);
  ETUDE_FIELD(height);
  ETUDE_FIELD_UP_TO(picture, 4u << 20);
  ETUDE_FIELD_UP_TO(waypoints, 4096);
  ETUDE_FIELD_UP_TO(view, 4);
  ETUDE_FIELD(worth_json);
  ETUDE_FIELD_UP_TO(what_if_waypoints, 4096);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, TrainStatus> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(step);
  ETUDE_FIELD(stage);
  ETUDE_FIELD(stages);
  ETUDE_FIELD(stage_name);
  ETUDE_FIELD(loss);
  ETUDE_FIELD(samples_per_second);
  ETUDE_FIELD(data_wait);
  ETUDE_FIELD(episodes);
  ETUDE_FIELD(eta_s);
  ETUDE_FIELD(checkpoint_step);
  ETUDE_FIELD(metrics_json);
  ETUDE_FIELD(finished);
  ETUDE_FIELD(run_id);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, PolicyStatus> {
  ETUDE_FIELD(run);
  ETUDE_FIELD(server);
  ETUDE_FIELD(run_id);
  ETUDE_FIELD(host);
  ETUDE_FIELD(pid);
  ETUDE_FIELD(channel);
  ETUDE_FIELD(step);
  ETUDE_FIELD(sha256);
  ETUDE_FIELD(stage);
  ETUDE_FIELD(stages);
  ETUDE_FIELD(stage_name);
  ETUDE_FIELD(control_trained);
  ETUDE_FIELD(since);
  ETUDE_FIELD(answered);
  ETUDE_FIELD(refused);
  ETUDE_FIELD(last_refusal);
  ETUDE_FIELD(p50_ms);
  ETUDE_FIELD(p95_ms);
  ETUDE_FIELD(sessions);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, ProcessStatus> {
  ETUDE_FIELD(process);
  ETUDE_FIELD(role);
  ETUDE_FIELD(host);
  ETUDE_FIELD(pid);
  ETUDE_FIELD(version);
  ETUDE_FIELD(since);
  ETUDE_FIELD(rss_bytes);
  ETUDE_FIELD(cpu);
  ETUDE_FIELD(folder);
  ETUDE_FIELD(disk_free_bytes);
  ETUDE_FIELD(disk_total_bytes);
  ETUDE_FIELD(participant);
  ETUDE_FIELD(topics_json);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, ProcessEvent> {
  ETUDE_FIELD(process);
  ETUDE_FIELD(role);
  ETUDE_FIELD(host);
  ETUDE_FIELD(number);
  ETUDE_FIELD(time_ms);
  ETUDE_FIELD(level);
  ETUDE_FIELD(code);
  ETUDE_FIELD(text);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, PlayCommand> {
  ETUDE_FIELD(session);
  ETUDE_FIELD(command_id);
  ETUDE_FIELD_UP_TO(action, PlayAction::kClose);
  ETUDE_FIELD(arguments_json);
  ETUDE_FIELD(host);
  ETUDE_FIELD(user);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, PlayState> {
  ETUDE_FIELD(session);
  ETUDE_FIELD(host);
  ETUDE_FIELD(pid);
  ETUDE_FIELD(run);
  ETUDE_FIELD(scene_json);
  ETUDE_FIELD(phase);
  ETUDE_FIELD(command_id);
  ETUDE_FIELD(refusal);
  ETUDE_FIELD(sentence);
  ETUDE_FIELD(meaning_json);
  ETUDE_FIELD(step);
  ETUDE_FIELD(max_steps);
  ETUDE_FIELD(judge_json);
  ETUDE_FIELD(outcome);
  ETUDE_FIELD(reason);
  ETUDE_FIELD_UP_TO(joints, 64);
  ETUDE_FIELD_UP_TO(waypoints, 4096);
  ETUDE_FIELD(modules_json);
  ETUDE_FIELD(checkpoint_step);
  ETUDE_FIELD(policy_ms);
  ETUDE_FIELD(speed);
  ETUDE_FIELD(attempts);
  ETUDE_FIELD(successes);
}

template <class F, class M, class W>
void Fields(F& f, M& m, W& w) requires std::is_same_v<std::remove_const_t<M>, PlayFrame> {
  ETUDE_FIELD(session);
  ETUDE_FIELD(number);
  ETUDE_FIELD(step);
  ETUDE_FIELD(width);
  ETUDE_FIELD(height);
  ETUDE_FIELD(format);
  ETUDE_FIELD_UP_TO(image, 1u << 20);
}

#undef ETUDE_FIELD
#undef ETUDE_FIELD_UP_TO

#define ETUDE_TRAITS(Name, topic_name, topic_qos, topic_scope, ...)                        \
  template <>                                                                              \
  struct Traits<Name> {                                                                    \
    using Role = security::Role;                                                           \
    using Wire = etude_wire_##Name;                                                        \
    static const dds_topic_descriptor_t& descriptor() { return etude_wire_##Name##_desc; } \
    static constexpr const char* kTopic = topic_name;                                      \
    static constexpr TopicQos kQos = topic_qos;                                            \
    static constexpr Access kAccess{Scope::topic_scope, __VA_ARGS__};                      \
  };

// topic, QoS, where it lives, who writes it, who reads it
ETUDE_TRAITS(Presence, "etude/directory/presence", kState, kDirectory,
             MaskOf(Role::kCollector, Role::kTrainer, Role::kPolicy, Role::kRelay), kEveryRole)
ETUDE_TRAITS(CampaignAnnouncement, "etude/campaign/announcement", kState, kCampaign, MaskOf(Role::kCollector),
             MaskOf(Role::kWorker, Role::kGateway, Role::kSubscriber))
ETUDE_TRAITS(WorkRequest, "etude/campaign/request", kEvents, kCampaign, MaskOf(Role::kWorker),
             MaskOf(Role::kCollector, Role::kGateway))
ETUDE_TRAITS(Lease, "etude/campaign/lease", kAnswers, kCampaignHost, MaskOf(Role::kCollector), MaskOf(Role::kWorker))
ETUDE_TRAITS(WorkerStatus, "etude/campaign/worker", kNewest, kCampaign, MaskOf(Role::kWorker),
             MaskOf(Role::kCollector, Role::kGateway))
ETUDE_TRAITS(AttemptReport, "etude/campaign/report", kEvents, kCampaign, MaskOf(Role::kWorker),
             MaskOf(Role::kCollector, Role::kGateway))
ETUDE_TRAITS(ValidationErrors, "etude/campaign/validation_errors", kNewest, kCampaign, MaskOf(Role::kTrainer),
             MaskOf(Role::kCollector))
ETUDE_TRAITS(CampaignStatus, "etude/campaign/status", kState, kCampaign, MaskOf(Role::kCollector),
             MaskOf(Role::kWorker, Role::kGateway, Role::kSubscriber))
ETUDE_TRAITS(CampaignControl, "etude/campaign/control", kEvents, kCampaign, MaskOf(Role::kGateway),
             MaskOf(Role::kCollector))
ETUDE_TRAITS(BlobManifest, "etude/blob/manifest", kEvents, kEpisodes, MaskOf(Role::kWorker), MaskOf(Role::kCollector))
ETUDE_TRAITS(BlobChunk, "etude/blob/chunk", kEvents, kEpisodes, MaskOf(Role::kWorker), MaskOf(Role::kCollector))
ETUDE_TRAITS(BlobAck, "etude/blob/ack", kAnswers, kCampaignHost, MaskOf(Role::kCollector), MaskOf(Role::kWorker))
ETUDE_TRAITS(Observation, "etude/policy/observation", kNewest, kRun,
             MaskOf(Role::kRobot, Role::kWorker, Role::kGateway), MaskOf(Role::kPolicy))
ETUDE_TRAITS(Action, "etude/policy/action", kNewest, kRunHost, MaskOf(Role::kPolicy),
             MaskOf(Role::kRobot, Role::kWorker, Role::kGateway))
ETUDE_TRAITS(InsightWish, "etude/policy/insight_wish", kNewest, kRun, MaskOf(Role::kGateway), MaskOf(Role::kPolicy))
ETUDE_TRAITS(Insight, "etude/policy/insight", kShown, kRun, MaskOf(Role::kPolicy), MaskOf(Role::kGateway))
ETUDE_TRAITS(PolicyStatus, "etude/policy/status", kState, kRun, MaskOf(Role::kPolicy),
             MaskOf(Role::kRobot, Role::kGateway, Role::kSubscriber))
ETUDE_TRAITS(PlayCommand, "etude/play/command", kEvents, kPlay, MaskOf(Role::kGateway), MaskOf(Role::kWorker))
ETUDE_TRAITS(PlayState, "etude/play/state", kNewest, kPlay, MaskOf(Role::kWorker), MaskOf(Role::kGateway))
ETUDE_TRAITS(PlayFrame, "etude/play/frame", kNewest, kPlay, MaskOf(Role::kWorker), MaskOf(Role::kGateway))
ETUDE_TRAITS(ProcessStatus, "etude/process/status", kNewest, kDirectory, kEveryRole, MaskOf(Role::kGateway))
ETUDE_TRAITS(ProcessEvent, "etude/process/event", kRecent, kDirectory, kEveryRole, MaskOf(Role::kGateway))
ETUDE_TRAITS(TrainStatus, "etude/train/status", kState, kRun, MaskOf(Role::kTrainer),
             MaskOf(Role::kGateway, Role::kSubscriber))

#undef ETUDE_TRAITS

/// All of them: what has no reader and writer, is not shown by `etude topic` and may be used by no role, is not here.
// clang-format off
#define ETUDE_MESSAGES(X) \
  X(Presence) X(CampaignAnnouncement) X(WorkRequest) X(Lease) X(WorkerStatus) X(AttemptReport) \
  X(ValidationErrors) X(CampaignStatus) X(CampaignControl) X(BlobManifest) X(BlobChunk) X(BlobAck) \
  X(Observation) X(Action) X(InsightWish) X(Insight) X(PolicyStatus) X(PlayCommand) \
  X(PlayState) X(PlayFrame) X(ProcessStatus) X(ProcessEvent) X(TrainStatus)
// clang-format on

inline constexpr char kPublishedManifestTopic[] = "etude/blob/published_manifest";
inline constexpr char kPublishedChunkTopic[] = "etude/blob/published_chunk";

}  // namespace etude::bus
