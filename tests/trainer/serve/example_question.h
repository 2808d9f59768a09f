// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "services/policy/policy_types.h"
#include "tests/trainer/serve/example_observation.h"

namespace etude::serve {

/// The same picture, joints and sentence as ExampleObservation(seed); `picture` holds what the question borrows.
inline policy::Question ExampleQuestion(std::uint64_t seed, std::vector<std::uint8_t>& picture) {
  bus::Observation observation = ExampleObservation(seed);
  picture = std::move(observation.image);
  policy::Question question;
  question.instruction = observation.instruction;
  question.joints = observation.joints;
  question.width = question.height = checkpoint::kExamplePicture;
  question.rgb = picture;
  return question;
}

}  // namespace etude::serve
