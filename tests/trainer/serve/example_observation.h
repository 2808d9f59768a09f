// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "services/bus/messages.h"
#include "services/core/rng.h"
#include "tests/trainer/checkpoint/example_checkpoint.h"

namespace etude::serve {

inline bus::Observation ExampleObservation(std::uint64_t seed, const std::string& run = "demo",
                                           const std::string& run_id = "") {
  Rng rng(seed);
  bus::Observation observation;
  observation.run = run;
  observation.run_id = run_id;
  observation.session = "client-" + std::to_string(seed);
  observation.request_id = seed + 1;
  observation.instruction = "pick up the red can";
  for (int i = 0; i < checkpoint::kExampleJoints; ++i)
    observation.joints.push_back(static_cast<float>(rng.Uniform(-1, 1)));
  observation.width = observation.height = checkpoint::kExamplePicture;
  observation.image.resize(checkpoint::kExamplePicture * checkpoint::kExamplePicture * 3);
  for (auto& pixel : observation.image) pixel = static_cast<std::uint8_t>(rng.Below(256));
  return observation;
}

}  // namespace etude::serve
