// SPDX-License-Identifier: Apache-2.0
// The stages of a task, by their names.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "worker/task/primitives/stage.h"

namespace etude::task {

inline const Stage& FindStage(const std::vector<Stage>& stages, const std::string& name) {
  for (const auto& stage : stages)
    if (stage.name == name) return stage;
  ADD_FAILURE() << name;
  return stages[0];
}

}  // namespace etude::task
