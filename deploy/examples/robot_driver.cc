// SPDX-License-Identifier: Apache-2.0
// A robot's driver: asks a policy over the bus and follows its answers, within limits of its own.
//   robot_driver RUN INSTRUCTION DOMAIN QUESTIONS [IDENTITY]
// IDENTITY: a folder of `etude security issue --role robot`, where the policy server has --robot-security.
// What the policy says is advice. The driver keeps the hand inside its workspace, below its speed, and still when no
// answer comes; it is the last one that can.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <string>

#include "deploy/examples/example_robot.h"
#include "services/bus/participant.h"
#include "services/core/stop.h"
#include "services/policy/client.h"

using namespace std::chrono_literals;

constexpr auto kWatchdog = 2000ms;       // without an answer for so long, the robot stands still
constexpr int kStepsPerAnswer = 15;      // of the 120 control steps (8 ms each) that an answer spans
constexpr double kMaxStep = 0.25 / 125;  // m a control step: 0.25 m/s
constexpr double kMaxTurn = 1.0 / 125;   // rad a control step: 1 rad/s
const Eigen::Vector3d kLow(-0.45, 0.05, 0.02), kHigh(0.45, 0.55, 0.50);  // m, world: the workspace

// The next command: towards what the policy wants, but inside the workspace and not too fast.
etude::Waypoint Within(const etude::Waypoint& now, etude::Waypoint wanted) {
  const Eigen::Vector3d goal = wanted.X_WE.p.cwiseMax(kLow).cwiseMin(kHigh);
  const Eigen::Vector3d way = goal - now.X_WE.p;
  wanted.X_WE.p = now.X_WE.p + way * std::min(1.0, kMaxStep / std::max(way.norm(), 1e-9));
  const double turn = now.X_WE.q.angularDistance(wanted.X_WE.q);
  wanted.X_WE.q = now.X_WE.q.slerp(std::min(1.0, kMaxTurn / std::max(turn, 1e-9)), wanted.X_WE.q);
  return wanted;
}

int main(int argc, char** argv) try {
  if (argc != 5 && argc != 6)
    return fmt::print(stderr, "usage: robot_driver RUN INSTRUCTION DOMAIN QUESTIONS [IDENTITY]\n"), 2;
  etude::InstallStopSignals();
  const auto domain = static_cast<std::uint32_t>(std::stoul(argv[3]));
  const auto participant = etude::bus::Participant::Open({domain, "", argc == 6 ? argv[5] : ""});
  if (!participant) return fmt::print(stderr, "{}\n", participant.error().message), 3;
  // one name a robot: two that share one take each other's place
  const std::string session = etude::bus::UniquePeerName();
  auto policy = etude::policy::Client::Open(*participant, argv[1], session, {kWatchdog / 2, kWatchdog});
  if (!policy) return fmt::print(stderr, "{}\n", policy.error().message), 2;

  ExampleRobot robot;  // yours: joint angles, a picture, and a controller for the hand's pose
  int answered = 0;
  for (int question = 0; question < std::stoi(argv[4]) && !etude::StopRequested(); ++question) {
    const auto answer = policy->Ask(robot.Look(argv[2]));
    if (!answer) {
      robot.Hold();
      fmt::print("holds still: {}\n", answer.error().message);
      continue;
    }
    // a network may answer with numbers that are no rotation; nobody after this program looks
    if (!std::ranges::all_of(answer->waypoints, [](const auto& w) { return w.X_WE.q.coeffs().allFinite(); })) {
      robot.Hold();
      continue;
    }
    ++answered;
    for (int step = 1; step <= kStepsPerAnswer; ++step)
      robot.Command(Within(robot.hand(), etude::Interpolate(answer->waypoints, step)));
    fmt::print("step {} of training: hand at {:.3f} {:.3f} {:.3f}\n", answer->checkpoint_step, robot.hand().X_WE.p.x(),
               robot.hand().X_WE.p.y(), robot.hand().X_WE.p.z());
  }
  return answered > 0 ? 0 : 3;
} catch (const std::exception& error) {  // DOMAIN or a count is no number
  return fmt::print(stderr, "robot_driver: a number was expected ({})\n", error.what()), 2;
}
