// SPDX-License-Identifier: Apache-2.0
// What somebody wants to see answered instead: another sentence, a part of the picture hidden, a module that says
// something else or thinks of another sentence, a part of it that nobody attends to; and whether to say what each word
// and joint is worth (worth.h), which is of what was observed.
//   {"sentence": "push the coke", "hide": [[100, 80, 12, 12]], "say": {"TAR3D": {"position": [0.1, 0.3, 0.04]}},
//    "worth": true}
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "trainer/policy/policy.h"

namespace etude::policy {

inline constexpr char kZeroRegister[] = "zero";

struct WhatIf {
  std::string sentence;                  ///< "": the one that was spoken
  std::vector<std::array<int, 4>> hide;  ///< u0, v0, width, height, px in the camera's picture: painted grey
  /// Rectangles as those: no module attends to what lies there, though it stays in the picture.
  std::vector<std::array<int, 4>> look_away;
  /// Module -> what it decodes -> value: numbers in SI units as DescribeModules says them, of a pose the place alone,
  /// or a name of class or task.
  std::map<std::string, std::map<std::string, OrderedJson>> say;
  /// Module -> the sentence that its register and what it decodes are of instead; kZeroRegister: a register of zeros.
  std::map<std::string, std::string> think;
  bool worth = false;  ///< what each word and joint is worth is asked as well

  /// Whether nothing is to be answered otherwise.
  bool empty() const { return sentence.empty() && hide.empty() && look_away.empty() && say.empty() && think.empty(); }
};

/// Of a text that is not trusted. @error kInvalidArgument: what is wrong, by key: unknown keys, modules and quantities
/// (with the nearest), values of another size or that no decoder reads, with what could be asked instead
Result<WhatIf> ParseWhatIf(const std::string& text, const PolicyConfig& config);

/// Grey over what is hidden. @param images  (1, 3, h, w) uint8, changed in place @param crop_origin  (1, 2) px
void Hide(const WhatIf& what_if, torch::Tensor images, const torch::Tensor& crop_origin);

/// Inputs::unattended of what is looked away from; undefined: nothing is. @param crop_origin  (1, 2) px
torch::Tensor Unattended(const WhatIf& what_if, const torch::Tensor& crop_origin);

/// What modules make of each sentence that some think of, by sentence.
using Thoughts = std::map<std::string, Outputs>;
Thoughts ThoughtsOf(const WhatIf& what_if, Policy& policy, Inputs inputs);

/// Replaces what modules decode. The registers stay: who reads those, and not what is decoded, does not notice; but for
/// modules that think otherwise. @param thoughts  as ThoughtsOf, of every sentence that some think of
Intervention SayInstead(const WhatIf& what_if, const PolicyConfig& config, Thoughts thoughts = {});

}  // namespace etude::policy
