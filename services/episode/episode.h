// SPDX-License-Identifier: Apache-2.0
// One demonstration or rollout, as every process sees it. Plain data; the file layout is in
// services/store, the wire format in services/episode/codec.h.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "services/codec/frames.h"
#include "services/core/config.h"
#include "services/episode/camera.h"

namespace etude {

/// Rows of floats, one a control step: (T, columns).
struct Track {
  int columns = 0;
  std::vector<float> values;

  int rows() const { return columns ? static_cast<int>(values.size()) / columns : 0; }
  std::span<const float> row(int t) const {
    return {values.data() + static_cast<std::size_t>(t) * columns, static_cast<std::size_t>(columns)};
  }
  /// Appends one row; its size must be `columns`.
  void Push(std::span<const float> row_values) { values.insert(values.end(), row_values.begin(), row_values.end()); }
};

/// Frames of one camera (height, width, 3; RGB, row-major, top row first) as zlib streams, which are exactly the bytes
/// that become the chunks of an HDF5 array: encoded once, never again. Frame k belongs to control step
/// k * image_stride; frame_cursor.h gives it.
struct CameraTrack {
  Camera camera;
  codec::ChunkShape chunk;
  std::vector<std::vector<std::uint8_t>> streams;  ///< layout().streams(FrameCount(...)) of them; none: not recorded

  codec::FrameLayout layout() const { return {camera.width, camera.height, chunk}; }
  /// None leave it as it is: not recorded.
  void Take(codec::DeflatedFrames frames) {
    if (frames.count > 0) chunk = frames.chunk;
    streams = std::move(frames.streams);
  }
};

struct ObjectTrack {
  std::string name;  ///< "coke"
  Track pose;        ///< (T, 7): x, y, z (m), quaternion w, x, y, z, in world
  Track pixel;       ///< (T, 2): projection of the body's centre of geometry into cameras[0], px
};

struct Episode {
  // identity
  std::string campaign;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t seed = 0;  ///< EpisodeSeed(spec, index, attempt)
  std::string spec_sha256;
  std::string scene_sha256;  ///< of the composed MJCF
  std::string version;       ///< of the content: kContentVersion

  // meaning
  std::string robot, task, target, reference, instruction;
  bool success = false;
  std::string outcome = "success";              ///< else AttemptOutcome as text, worker/task/verdict.h
  OrderedJson details = OrderedJson::object();  ///< scene, plans, what judges say; no timings (they vary)

  // low-dimensional, one row a control step (125 Hz); T rows each
  Track joint_pos;                      ///< arm joints, rad
  Track joint_vel;                      ///< arm joints, rad/s
  Track gripper_qpos;                   ///< driven gripper joint(s), rad or m
  Track eef_pos;                        ///< p_WE, m
  Track eef_quat;                       ///< q_WE as w, x, y, z
  Track eef_pixel;                      ///< (T, 2) projection of p_WE into cameras[0], px
  Track actions_abs;                    ///< (T, 10) commanded, as in action.h: x, y, z, rotation in 6D, gripper 0|1
  Track states;                         ///< qpos and qvel, flattened
  std::vector<std::uint8_t> phase;      ///< (T,) stage of the expert; names in stage_names
  std::vector<std::uint8_t> supervise;  ///< (T,) 0 where a disturbance drives the arm: not to imitate
  std::vector<std::string> stage_names;

  std::vector<ObjectTrack> objects;
  int image_stride = 5;  ///< control steps per frame
  std::vector<CameraTrack> cameras;

  int steps() const { return eef_pos.rows(); }
  const ObjectTrack* FindObject(const std::string& name) const;
};

}  // namespace etude
