// SPDX-License-Identifier: Apache-2.0
// A rollout that costs little: pictures are small and rare, and a scripted policy does not look at them.
#pragma once

#include <string>

#include "services/spec/campaign_spec.h"

namespace etude::task {

/// @param run  whose policy drives
inline CampaignSpec CheapRollout(const std::string& task, const std::string& run) {
  CampaignSpec spec;
  spec.mode = "rollout";
  spec.tasks = {task};
  spec.seed = 31;
  spec.image_stride = 50;
  spec.camera.width = spec.camera.height = 64;
  spec.rollout.run = run;
  return spec;
}

}  // namespace etude::task
