// SPDX-License-Identifier: Apache-2.0
// What it costs robots that a policy can be looked into: answers a second of `etude-policy` with preset compact, to one
// policy::Client that asks one question after the other over DDS. A line each:
//   insight_none       nobody has wished for an insight
//   insight_expired    somebody has, for this robot, and the wish has run out
//   insight_elsewhere  a wish stands for another robot, which is silent
//   insight_watched    a wish stands for this robot, and every insight is taken
// against the server's loop as it was before there were insights (ServeAsBefore). Every side is a process of its own;
// all run in turn in every round, each round beginning with another one, and ratios are of sides of the same round.
//   insight_bench [rounds] [seconds of each side in a round]
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/addressed_writers.h"
#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/check.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/config.h"
#include "services/core/stop.h"
#include "services/policy/client.h"
#include "tests/bench/processes.h"
#include "tests/support/programs_folder.h"
#include "tests/support/temporary_folder.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/policy/torch_process.h"
#include "trainer/serve/latency.h"
#include "trainer/serve/model.h"

namespace etude {
namespace {

using namespace std::chrono_literals;

constexpr std::uint32_t kDomain = 70;
constexpr int kPicture = 224;  // px
constexpr int kJoints = 7;
constexpr char kProfile[] = "deploy/dds/local.xml";
constexpr auto kMeet = 60s;          // until a server has read its checkpoint
constexpr double kQuietS = 1.5;      // without an insight, of ten a second: the wish is over
constexpr std::uint32_t kLong = 60;  // s that a wish stands

// ---- the server of before -------------------------------------------------------------------------

// What PolicyServer does with an observation, without the desk that insights are made at.
Status ServeAsBefore(const Path& checkpoint, const std::string& run) {
  policy::SetTorchThreads(1);
  ETUDE_ASSIGN_OR_RETURN(const auto model, serve::Model::FromFile(checkpoint));
  ETUDE_ASSIGN_OR_RETURN(const Selector selector, ParseSelector(run, "run"));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open({kDomain, ""}));
  const bus::Owner owner{selector.name, selector.id};
  const std::string partition = owner.partition();
  bus::AddressedWriters<bus::Action> actions(participant, partition);
  ETUDE_ASSIGN_OR_RETURN(auto observations, bus::Reader<bus::Observation>::Open(participant, partition));
  const auto presence = bus::MakePresence(bus::PresenceKind::kPolicy, selector.name, selector.id, "");
  ETUDE_ASSIGN_OR_RETURN(const auto announced, bus::Announcement::Open(participant, presence, Claim::kAdopt));
  serve::LatencyMeter latency;
  while (!StopRequested()) {
    if (actions.waiting()) actions.Tidy();
    if (!observations.Wait(actions.waiting() ? 5ms : 100ms)) continue;
    const Stopwatch since_arrival;
    const auto taken = observations.Take();
    std::map<std::string, const bus::Observation*> newest;
    for (const auto& observation : taken)
      if (observation.run_id == selector.id) newest[observation.session] = &observation;
    for (const auto& [session, observation] : newest) {
      bus::Action action = model->Answer(*observation);
      const serve::Latency measured = latency.Now();
      action.server_p50_ms = static_cast<float>(measured.p50_ms);
      action.server_p99_ms = static_cast<float>(measured.p99_ms);
      ETUDE_RETURN_IF_ERROR(actions.Write(observation->host, action));
      latency.Add(1000 * since_arrival.Seconds());
    }
  }
  return {};
}

// ---- what is served --------------------------------------------------------------------------------

// Preset compact with random weights that claim to be trained: how long an answer takes does not depend on them.
Status WriteCheckpoint(const Path& file) {
  ETUDE_ASSIGN_OR_RETURN(const auto config, LoadConfig<policy::PolicyConfig>(
                                                "trainer/experiments/policies/compact/base.yaml",
                                                {"image.crop=[41,75,144,80]", "tasks=[pick, push, put_down]"}));
  ETUDE_ASSIGN_OR_RETURN(const auto network, policy::Policy::Create(config, policy::Normalization::Unit(kJoints), 1));
  checkpoint::Checkpoint made;
  checkpoint::Metadata& metadata = made.metadata;
  metadata.run = "insight-bench";
  metadata.step = 100;
  metadata.stage_name = "CTRL";
  metadata.embodiment = {.robot = "ur5", .joints = kJoints, .width = kPicture, .height = kPicture};
  metadata.policy = config;
  for (const auto& module : config.modules) metadata.modules[module.name] = {100, 0.01};
  for (const auto& [name, tensor] : network->StateTensors()) made.tensors[name] = tensor.detach().clone();
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, checkpoint::Encode(made));
  return WriteFileAtomically(file, bytes);
}

// ---- who asks, and who looks -------------------------------------------------------------------------

class Robot {
 public:
  Robot(const bus::Participant& participant, const Selector& run, const std::string& session) {
    auto client = policy::Client::Open(participant, run.text(), session);
    ETUDE_CHECK(client, "{}", client.error().message);
    client_.emplace(std::move(*client));
    for (std::size_t i = 0; i < picture_.size(); ++i) picture_[i] = static_cast<std::uint8_t>(i * 31 + i / 255);
    question_.instruction = "pick up the red can";
    question_.joints.assign(kJoints, 0.1F);
    question_.width = question_.height = kPicture;
    question_.rgb = picture_;
  }
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;

  void Ask() {
    question_.joints[0] += 1e-4F;
    const auto answer = client_->Ask(question_);
    ETUDE_CHECK(answer, "{}", answer.error().message);
  }

 private:
  std::optional<policy::Client> client_;
  std::vector<std::uint8_t> picture_ = std::vector<std::uint8_t>(std::size_t{3} * kPicture * kPicture);
  policy::Question question_;
};

class Viewer {
 public:
  Viewer(const bus::Participant& participant, const Selector& run, const std::string& session)
      : wishes_(Open<bus::Writer<bus::InsightWish>>(participant, run)),
        insights_(Open<bus::Reader<bus::Insight>>(participant, run)) {
    wish_.run = run.name;
    wish_.run_id = run.id;
    wish_.viewer = "viewer-of-" + session;
    wish_.session = session;
    ETUDE_CHECK(wishes_.WaitForReaders(1, kMeet), "no policy server of run {}", run.text());
  }

  /// Wishes for `seconds`; returns once it has been shown something.
  void Wish(std::uint32_t seconds, Robot& robot) {
    (void)insights_.Take();
    wish_.seconds = seconds;
    const Status written = wishes_.Write(wish_);
    ETUDE_CHECK(written, "{}", written.error().message);
    const Stopwatch watch;
    while (Take() == 0) {
      ETUDE_CHECK(watch.Seconds() < 20, "no insight into run {}", wish_.run);
      robot.Ask();
    }
  }
  /// Insights since the last call.
  std::size_t Take() { return insights_.Take().size(); }

 private:
  template <class Endpoint>
  static Endpoint Open(const bus::Participant& participant, const Selector& run) {
    auto opened = Endpoint::Open(participant, bus::Owner{run.name, run.id}.partition());
    ETUDE_CHECK(opened, "{}", opened.error().message);
    return std::move(*opened);
  }

  bus::Writer<bus::InsightWish> wishes_;
  bus::Reader<bus::Insight> insights_;
  bus::InsightWish wish_;
};

// ---- the sides -----------------------------------------------------------------------------------------

enum class Looking { kBefore, kNobody, kNoLonger, kElsewhere, kHere };
constexpr std::array<std::pair<Looking, const char*>, 5> kSides{{{Looking::kBefore, "before"},
                                                                 {Looking::kNobody, "none"},
                                                                 {Looking::kNoLonger, "expired"},
                                                                 {Looking::kElsewhere, "elsewhere"},
                                                                 {Looking::kHere, "watched"}}};

class Side {
 public:
  Side(const bus::Participant& participant, Looking looking, const std::string& name, const Path& checkpoint)
      : looking_(looking),
        run_{"insight-" + name, NewId()},
        server_(looking == Looking::kBefore
                    ? bench::Self({"before", checkpoint.string(), run_.text()})
                    : std::vector<std::string>{(ProgramsFolder() / "etude-policy").string(), "--checkpoint",
                                               checkpoint.string(), "--run", run_.text(), "--domain",
                                               std::to_string(kDomain)}),
        robot_(participant, run_, "robot"),
        other_(participant, run_, "other") {
    for (int i = 0; i < 30; ++i) robot_.Ask();  // caches, and the server's own measure of itself
    if (looking == Looking::kBefore || looking == Looking::kNobody) return;
    viewer_.emplace(participant, run_, looking == Looking::kElsewhere ? "other" : "robot");
    if (looking == Looking::kNoLonger) LetAWishRunOut();
  }

  /// Answers a second.
  double Measure(double seconds) {
    if (looking_ == Looking::kElsewhere) viewer_->Wish(kLong, other_);
    if (looking_ == Looking::kHere) viewer_->Wish(kLong, robot_);
    std::size_t answers = 0, insights = 0;
    const Stopwatch watch;
    for (; watch.Seconds() < seconds && !StopRequested(); ++answers) {
      robot_.Ask();
      if (looking_ == Looking::kHere) insights += viewer_->Take();
    }
    const double rate = static_cast<double>(answers) / watch.Seconds();
    // what was to be measured was there
    if (looking_ == Looking::kHere) ETUDE_CHECK(insights > 0 || StopRequested(), "nothing was shown");
    if (looking_ == Looking::kNoLonger) ETUDE_CHECK(viewer_->Take() == 0, "a wish stood that should be over");
    return rate;
  }

 private:
  void LetAWishRunOut() {
    viewer_->Wish(1, robot_);
    Stopwatch quiet;
    while (quiet.Seconds() < kQuietS && !StopRequested()) {
      robot_.Ask();
      if (viewer_->Take() > 0) quiet.Restart();
    }
  }

  const Looking looking_;
  const Selector run_;
  bench::Child server_;
  Robot robot_, other_;
  std::optional<Viewer> viewer_;
};

void Print(const std::string& name, const std::vector<double>& rates, const std::vector<double>& before) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < rates.size(); ++i) ratios.push_back(rates[i] / before[i]);
  fmt::print(stderr, "{:<10} {} answers/s, {} of before\n", name, bench::Summary(rates), bench::Summary(ratios));
  fmt::print("{}\n", OrderedJson{{"name", "insight_" + name},
                                 {"value", bench::Median(rates)},
                                 {"unit", "answers/s"},
                                 {"baseline", bench::Median(before)},
                                 {"ratio", bench::Median(ratios)}}
                         .dump());
  std::fflush(stdout);
}

Status Bench(int rounds, double seconds) {
  const double calibration = bench::TwoProcessSpin();
  bench::UseProfile(kProfile);
  const TemporaryFolder folder;
  ETUDE_RETURN_IF_ERROR(WriteCheckpoint(folder / "compact.safetensors"));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, bus::Participant::Open({kDomain, ""}));
  std::vector<std::unique_ptr<Side>> sides;
  for (const auto& [looking, name] : kSides)
    sides.push_back(std::make_unique<Side>(participant, looking, name, folder / "compact.safetensors"));
  std::vector<std::vector<double>> rates(sides.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t i = 0; i < sides.size(); ++i) {
      const std::size_t side = (i + static_cast<std::size_t>(round)) % sides.size();
      rates[side].push_back(sides[side]->Measure(seconds));
      if (StopRequested()) return Fail(Code::kUnavailable, "the bench was stopped");
    }
  }
  for (std::size_t side = 1; side < sides.size(); ++side) Print(kSides[side].second, rates[side], rates[0]);
  sides.clear();
  bench::PrintCalibration(calibration, bench::TwoProcessSpin());
  return {};
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  etude::policy::PrepareTorchProcess(argv);
  ::setenv("ETUDE_LOG", "error", 0);
  return etude::RunMain("insight_bench", [&] {
    if (argc == 4 && std::strcmp(argv[1], "before") == 0) return etude::ServeAsBefore(argv[2], argv[3]);
    return etude::Bench(argc > 1 ? std::max(1, std::atoi(argv[1])) : 15, argc > 2 ? std::atof(argv[2]) : 1.0);
  });
}
