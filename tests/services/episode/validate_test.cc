// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/validate.cc
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "services/episode/codec.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"

namespace etude {
namespace validate_test {

struct Fault {
  const char* name;
  std::function<void(Episode&)> apply;
  const char* message;  // part of it
};

const std::vector<Fault>& Faults() {
  static const float kNan = std::numeric_limits<float>::quiet_NaN();
  static const std::vector<Fault> faults{
      {"no_steps", [](Episode& e) { e.eef_pos.values.clear(); }, "steps"},
      {"missing_row", [](Episode& e) { e.joint_pos.values.resize(e.joint_pos.values.size() - 6); }, "joint_pos"},
      {"torn_row", [](Episode& e) { e.joint_vel.values.pop_back(); }, "joint_vel"},
      {"wrong_columns", [](Episode& e) { e.actions_abs.columns = 6; }, "actions_abs"},
      {"no_columns", [](Episode& e) { e.gripper_qpos = {}; }, "gripper_qpos"},
      {"nan_pose", [](Episode& e) { e.objects[2].pose.values[8] = kNan; }, "not finite"},
      {"infinite", [](Episode& e) { e.states.values[3] = std::numeric_limits<float>::infinity(); }, "states"},
      {"long_quaternion", [](Episode& e) { e.eef_quat.values[0] = 0.5f; }, "unit"},
      {"object_quaternion", [](Episode& e) { e.objects[0].pose.values[4] = 1; }, "unit"},
      {"no_rotation", [](Episode& e) { e.actions_abs.values[3] = 0.5f; }, "rotation"},
      {"short_phase", [](Episode& e) { e.phase.pop_back(); }, "phase"},
      {"unnamed_phase", [](Episode& e) { e.phase[3] = 2; }, "phase"},
      {"supervise", [](Episode& e) { e.supervise[0] = 2; }, "supervise"},
      {"object_twice", [](Episode& e) { e.objects[1].name = e.objects[0].name; }, "objects"},
      {"object_path", [](Episode& e) { e.objects[1].name = "../x"; }, "objects"},
      {"camera_name", [](Episode& e) { e.cameras[0].camera.name = "a/b"; }, "cameras"},
      {"camera_size", [](Episode& e) { e.cameras[0].camera.width = 0; }, "px"},
      {"camera_huge", [](Episode& e) { e.cameras[0].camera.height = 1 << 20; }, "px"},
      {"camera_fovy", [](Episode& e) { e.cameras[0].camera.fovy = NAN; }, "field of view"},
      {"camera_pose", [](Episode& e) { e.cameras[0].camera.X_WC.p.x() = NAN; }, "pose"},
      {"frame_missing", [](Episode& e) { e.cameras[0].streams.pop_back(); }, "3 streams of frames, not 4"},
      {"frame_empty", [](Episode& e) { e.cameras[0].streams[1].clear(); }, "stream of 0"},
      {"frame_huge", [](Episode& e) { e.cameras[0].streams[1].resize(1 << 20); }, "stream of"},
      {"chunk_of_none", [](Episode& e) { e.cameras[0].chunk.frames = 0; }, "chunks of 0"},
      {"chunk_of_rows", [](Episode& e) { e.cameras[0].chunk.rows = 33; }, "x 33 rows"},
      {"chunk_huge", [](Episode& e) { e.cameras[0].chunk.frames = 4000000; }, "chunks of 4000000"},
      {"chunk_of_more", [](Episode& e) { e.cameras[0].chunk.frames = 5, e.cameras[0].streams.resize(2); },
       "chunks of 5 frames, there are 4"},
      {"stride", [](Episode& e) { e.image_stride = 0; }, "image_stride"},
      {"nul_text", [](Episode& e) { e.instruction = std::string("a\0b", 3); }, "instruction"},
      {"long_text", [](Episode& e) { e.outcome.assign(5000, 'x'); }, "outcome"},
      {"details", [](Episode& e) { e.details = 5; }, "details"},
  };
  return faults;
}

TEST(ValidateEpisode, NamesEveryFault) {
  const CampaignSpec spec = SyntheticSpec();
  for (const Fault& fault : Faults()) {
    Episode episode = Recut(MakeSyntheticEpisode(spec, 1, 20), {2, 16});
    fault.apply(episode);

    const Status status = ValidateEpisode(episode);

    EXPECT_THAT(status, HasCode(Code::kInvalidArgument)) << fault.name;
    EXPECT_THAT(status, MessageHas(fault.message)) << fault.name;
    EXPECT_THAT(DecodeEpisode(EncodeEpisode(episode)), HasCode(Code::kCorrupt)) << fault.name;
  }
}

TEST(ValidateEpisode, AllowsWhatMayBeAbsent) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 1, 20);
  episode.states = {};
  episode.objects[0].pixel.values[0] = NAN;  // behind the camera
  episode.cameras[0].streams.clear();        // a rollout that is not recorded
  episode.phase.assign(20, 0);
  episode.stage_names.clear();

  EXPECT_THAT(ValidateEpisode(episode), IsOk());
  episode.cameras.clear();
  episode.objects.clear();
  EXPECT_THAT(ValidateEpisode(episode), IsOk());
}

}  // namespace validate_test
}  // namespace etude
