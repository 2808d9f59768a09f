// SPDX-License-Identifier: Apache-2.0
#include "trainer/data/statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "services/episode/trajectory_label.h"

namespace etude::data {
namespace {

constexpr double kMinJointStd = 0.05;     // rad
constexpr double kMinPositionStd = 0.02;  // m
constexpr double kMinOffsetStd = 0.005;   // m
// more frames than this change nothing in the third digit
constexpr std::size_t kFrames = 20000;

// sums of values and squares, a column each
class Moments {
 public:
  explicit Moments(std::size_t columns) : sum_(columns), square_(columns), count_(columns) {}

  void Add(std::size_t column, double value) {
    sum_[column] += value;
    square_[column] += value * value;
    ++count_[column];
  }
  std::vector<float> Mean() const {
    std::vector<float> mean;
    for (std::size_t i = 0; i < sum_.size(); ++i)
      mean.push_back(static_cast<float>(sum_[i] / static_cast<double>(count_[i])));
    return mean;
  }
  std::vector<float> Std(double least) const {
    std::vector<float> std_dev;
    for (std::size_t i = 0; i < sum_.size(); ++i) {
      const double n = static_cast<double>(count_[i]), mean = sum_[i] / n;
      std_dev.push_back(static_cast<float>(std::max(least, std::sqrt(std::max(0.0, square_[i] / n - mean * mean)))));
    }
    return std_dev;
  }
  std::vector<float> RootMeanSquare(double least) const {
    std::vector<float> rms;
    for (std::size_t i = 0; i < square_.size(); ++i)
      rms.push_back(static_cast<float>(
          count_[i] ? std::max(least, std::sqrt(square_[i] / static_cast<double>(count_[i]))) : 1.0));
    return rms;
  }

 private:
  std::vector<double> sum_, square_;
  std::vector<std::size_t> count_;
};

struct AllMoments {
  explicit AllMoments(std::size_t joints) : joint(joints) {}
  Moments joint, position{3}, displacement{3}, offset{3 * kWaypoints};

  void AddFrame(const Episode& episode, int step) {
    std::size_t j = 0;
    for (float q : episode.joint_pos.row(step)) joint.Add(j++, q);
    for (float q : episode.gripper_qpos.row(step)) joint.Add(j++, q);

    const auto hand = episode.eef_pos.row(step);
    for (int i = 0; i < 3; ++i) position.Add(i, hand[i]);
    for (const auto& object : episode.objects) {
      const auto pose = object.pose.row(step);
      for (int i = 0; i < 3; ++i) position.Add(i, pose[i]);
      for (int i = 0; i < 3; ++i) displacement.Add(i, pose[i] - hand[i]);
    }
    const TrajectoryLabel label = LabelTrajectory(episode, step);
    for (int k = 0; k < kWaypoints; ++k)
      for (int i = 0; label.valid[k] && i < 3; ++i)
        offset.Add(3 * k + i, label.values[k * kWaypointSize + i] - hand[i]);
  }
};

}  // namespace

Result<Statistics> ComputeStatistics(const Snapshot& snapshot) {
  const std::size_t frames = snapshot.frame_count(Split::kTrain);
  if (frames == 0)
    return Fail(Code::kNotFound,
                fmt::format("the training split has no frame ({} episodes in all)", snapshot.episodes().size()));
  const auto& first = snapshot.frames(Split::kTrain).begin()->second.front();
  const Episode& any = snapshot.episodes()[first.episode]->episode();
  const int joints = any.joint_pos.columns + any.gripper_qpos.columns;

  const EpisodeEntry& one = *snapshot.episodes().front();
  for (const auto& entry : snapshot.episodes())
    if (entry->episode().robot != one.episode().robot)
      return Fail(Code::kInvalidArgument,
                  fmt::format("the data mix robots: '{}' is the {}'s, '{}' the {}'s; a policy drives one: collect a "
                              "dataset for each (robots: [{}])",
                              entry->record.path.string(), entry->episode().robot, one.record.path.string(),
                              one.episode().robot, one.episode().robot));
  AllMoments moments(static_cast<std::size_t>(joints));
  const std::size_t stride = std::max<std::size_t>(1, frames / kFrames);
  std::size_t count = 0;
  for (const auto& [task, refs] : snapshot.frames(Split::kTrain)) {
    for (const FrameRef& ref : refs) {
      if (count++ % stride != 0) continue;
      const EpisodeEntry& entry = *snapshot.episodes()[ref.episode];
      const Episode& episode = entry.episode();
      if (episode.joint_pos.columns + episode.gripper_qpos.columns != joints)
        return Fail(Code::kCorrupt, fmt::format("'{}' has {} joints, others {}", entry.record.path.string(),
                                                episode.joint_pos.columns + episode.gripper_qpos.columns, joints));
      moments.AddFrame(episode, entry.StepOf(ref.frame));
    }
  }
  return Statistics{moments.joint.Mean(),
                    moments.joint.Std(kMinJointStd),
                    moments.position.Mean(),
                    moments.position.Std(kMinPositionStd),
                    moments.displacement.RootMeanSquare(kMinPositionStd),
                    moments.offset.RootMeanSquare(kMinOffsetStd)};
}

}  // namespace etude::data
