// SPDX-License-Identifier: Apache-2.0
#include "worker/host/messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "services/spec/sampling_weights.h"

namespace etude::host {
namespace {

constexpr int kMostPixels = 4096;  // a side
constexpr int kLastCode = static_cast<int>(Code::kInternal);

// Reads with nlohmann's checks of types, which throw: every wrong one is the same error.
template <class Read>
auto Checked(const char* what, const Read& read) -> Result<decltype(read())> {
  try {
    return read();
  } catch (const OrderedJson::exception& error) {
    return Fail(Code::kCorrupt, fmt::format("read {} from a frame: {}", what, error.what()));
  }
}

OrderedJson PoseJson(const Pose& pose) {
  return {pose.p.x(), pose.p.y(), pose.p.z(), pose.q.w(), pose.q.x(), pose.q.y(), pose.q.z()};
}

Pose PoseOf(const OrderedJson& json) {
  const auto at = [&](int k) { return json.at(static_cast<std::size_t>(k)).get<double>(); };
  return {{at(0), at(1), at(2)}, Eigen::Quaterniond(at(3), at(4), at(5), at(6))};
}

// Of an answer, whose rotation may be none (services/policy/client.h): for NaN JSON has null.
Pose AnsweredPoseOf(OrderedJson json) {
  for (OrderedJson& number : json)
    if (number.is_null()) number = std::numeric_limits<double>::quiet_NaN();
  return PoseOf(json);
}

}  // namespace

OrderedJson CampaignHead(const campaign::JoinedCampaign& joined) {
  return {{"id", joined.id},
          {"spec", ToJson(joined.spec)},
          {"policy", joined.policy},
          {"spec_sha256", joined.spec_sha256},
          {"fingerprint", campaign::FingerprintText(joined.fingerprint)}};
}

Result<campaign::JoinedCampaign> CampaignOf(const OrderedJson& head) {
  campaign::JoinedCampaign joined;
  std::string fingerprint;
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson spec, Checked("a campaign", [&] {
                           joined.id = head.at("id").get<std::string>();
                           joined.policy = head.at("policy").get<std::string>();
                           joined.spec_sha256 = head.at("spec_sha256").get<std::string>();
                           fingerprint = head.value("fingerprint", "{}");  // an older host says none
                           return head.at("spec");
                         }));
  ETUDE_ASSIGN_OR_RETURN(joined.fingerprint, campaign::ParseFingerprint(fingerprint));
  ETUDE_ASSIGN_OR_RETURN(joined.spec, FromJson<CampaignSpec>(spec, "a host's campaign"));
  return joined;
}

OrderedJson WorkHead(const campaign::WorkItem& item) {
  return {{"index", item.index}, {"attempt", item.attempt}, {"weights", WeightsText(item.weights)}};
}

Result<campaign::WorkItem> WorkOf(const OrderedJson& head, const CampaignSpec& spec) {
  campaign::WorkItem item;
  ETUDE_ASSIGN_OR_RETURN(const std::string weights, Checked("a work item", [&] {
                           item.index = head.at("index").get<std::uint64_t>();
                           item.attempt = head.at("attempt").get<std::uint32_t>();
                           return head.at("weights").get<std::string>();
                         }));
  ETUDE_ASSIGN_OR_RETURN(item.weights, ParseWeights(weights, spec));
  return item;
}

OrderedJson ResultHead(const campaign::WorkResult& result) {
  return {{"outcome", result.outcome},
          {"details", result.details_json},
          {"steps", result.steps},
          {"frames", result.frames},
          {"times", TimesJson(result.times)}};
}

Result<campaign::WorkResult> ResultOf(Frame frame) {
  return Checked("a result", [&] {
    const OrderedJson& head = frame.head;
    campaign::WorkResult result;
    result.outcome = head.at("outcome").get<std::string>();
    result.details_json = head.at("details").get<std::string>();
    result.steps = head.at("steps").get<std::uint64_t>();
    result.frames = head.at("frames").get<std::uint64_t>();
    result.times = TimesOf(head.at("times"));
    result.episode = std::move(frame.bytes);
    return result;
  });
}

OrderedJson QuestionHead(const policy::Question& question) {
  OrderedJson head{{"instruction", question.instruction},
                   {"joints", question.joints},
                   {"width", question.width},
                   {"height", question.height},
                   {"robot", question.robot}};
  if (!question.camera) return head;
  const Camera& camera = *question.camera;
  head["camera"] = {{"name", camera.name},
                    {"width", camera.width},
                    {"height", camera.height},
                    {"fovy", camera.fovy},
                    {"pose", PoseJson(camera.X_WC)}};
  return head;
}

Result<policy::Question> QuestionOf(const Frame& frame) {
  ETUDE_ASSIGN_OR_RETURN(policy::Question question, Checked("a question", [&] {
                           const OrderedJson& head = frame.head;
                           policy::Question read;
                           read.instruction = head.at("instruction").get<std::string>();
                           read.joints = head.at("joints").get<std::vector<float>>();
                           read.width = head.at("width").get<int>();
                           read.height = head.at("height").get<int>();
                           read.robot = head.at("robot").get<std::string>();
                           if (head.contains("camera")) {
                             const OrderedJson& camera = head.at("camera");
                             read.camera = Camera{camera.at("name").get<std::string>(), camera.at("width").get<int>(),
                                                  camera.at("height").get<int>(), camera.at("fovy").get<double>(),
                                                  PoseOf(camera.at("pose"))};
                           }
                           return read;
                         }));
  const auto in_range = [](int pixels) { return pixels >= 0 && pixels <= kMostPixels; };
  if (!in_range(question.width) || !in_range(question.height) ||
      frame.bytes.size() != static_cast<std::size_t>(question.width) * static_cast<std::size_t>(question.height) * 3)
    return Fail(Code::kCorrupt, fmt::format("read a question from a frame: {} bytes for a picture of {}x{} px",
                                            frame.bytes.size(), question.width, question.height));
  question.rgb = frame.bytes;
  return question;
}

OrderedJson AnswerHead(const policy::Answer& answer) {
  OrderedJson waypoints = OrderedJson::array();
  for (const Waypoint& waypoint : answer.waypoints)
    waypoints.push_back({{"pose", PoseJson(waypoint.X_WE)}, {"gripper", waypoint.gripper}});
  return {{"waypoints", waypoints},
          {"modules", answer.modules},
          {"checkpoint_step", answer.checkpoint_step},
          {"server_p99_ms", answer.server_p99_ms}};
}

Result<policy::Answer> AnswerOf(const OrderedJson& head) {
  return Checked("an answer", [&] {
    policy::Answer answer;
    for (const OrderedJson& waypoint : head.at("waypoints"))
      answer.waypoints.push_back({AnsweredPoseOf(waypoint.at("pose")), waypoint.at("gripper").get<double>()});
    answer.modules = head.at("modules");
    answer.checkpoint_step = head.at("checkpoint_step").get<std::uint64_t>();
    answer.server_p99_ms = head.at("server_p99_ms").get<double>();
    return answer;
  });
}

OrderedJson ErrorHead(const Error& error) {
  return {{"code", static_cast<int>(error.code)}, {"message", error.message}};
}

Error ErrorOf(const OrderedJson& head) {
  const auto read = Checked("an error", [&] {
    return Error{static_cast<Code>(std::clamp(head.at("code").get<int>(), 0, kLastCode)),
                 head.at("message").get<std::string>()};
  });
  return read ? *read : read.error();
}

}  // namespace etude::host
