// SPDX-License-Identifier: Apache-2.0
// Experiment "compact" made small enough for tests: its graph on synthetic pictures of 48 px. No torch here.
#pragma once

#include <string>
#include <vector>

namespace etude::learn {

inline constexpr int kTinyPicture = 48;  // px

/// KEY=VALUE over the experiment's.
inline std::vector<std::string> TinyOverrides() {
  return {"policy.image.crop=[2, 2, 44, 44]",
          "policy.image.layers=[{kind: conv, channels: 16, kernel: 5, stride: "
          "2}, {kind: residual, channels: 16}]",
          "policy.width=32",
          "policy.precision=float32",
          "policy.joint_hidden=[32]",
          "policy.language.buckets=1024",
          "policy.language.width=32",
          "policy.language.hidden=64",
          "policy.tasks=[pick, push, put_down]",
          "data.batch=16",
          "data.jitter=2",
          "data.cache_mb=64",
          "data.min_episodes=8",
          "data.min_valid=1",
          "data.refresh_s=0.05",
          "optimizer.warmup_steps=10",
          "eval.every_steps=10",
          "eval.frames=48",
          "checkpoint.every_steps=10",
          "threads.replicas=1",
          "steps=20"};
}

}  // namespace etude::learn
