// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/quantities/rotation.h"

#include "services/core/check.h"

namespace etude::policy {
namespace {

using torch::Tensor;

Tensor At(const Tensor& x, int i) { return x.select(-1, i); }

Tensor Unit(const Tensor& v) { return v / v.norm(2, -1, true).clamp_min(1e-9); }

Tensor FromColumns(const Tensor& columns) {
  const Tensor x = Unit(columns.narrow(-1, 0, 3)), second = columns.narrow(-1, 3, 3);
  const Tensor y = Unit(second - (x * second).sum(-1, true) * x);
  return torch::stack({x, y, torch::cross(x, y, -1)}, -1);
}

// Rx(roll) Ry(pitch) Rz(yaw)
Tensor FromEulerSincos(const Tensor& values) {
  const auto angle = [&](int i) { return torch::atan2(At(values, 2 * i), At(values, 2 * i + 1)); };
  const Tensor roll = angle(0), pitch = angle(1), yaw = angle(2);
  const Tensor sr = roll.sin(), cr = roll.cos(), sp = pitch.sin(), cp = pitch.cos(), sy = yaw.sin(), cy = yaw.cos();
  const Tensor rows = torch::stack({cp * cy, -cp * sy, sp, cr * sy + sr * sp * cy, cr * cy - sr * sp * sy, -sr * cp,
                                    sr * sy - cr * sp * cy, sr * cy + cr * sp * sy, cr * cp},
                                   -1);
  return rows.unflatten(-1, {3, 3});
}

Tensor EulerSincosOf(const Tensor& R) {
  const auto at = [&](int i, int j) { return R.select(-2, i).select(-1, j); };
  const Tensor roll = torch::atan2(-at(1, 2), at(2, 2)), yaw = torch::atan2(-at(0, 1), at(0, 0));
  const Tensor pitch = torch::asin(at(0, 2).clamp(-1, 1));
  return torch::stack({roll.sin(), roll.cos(), pitch.sin(), pitch.cos(), yaw.sin(), yaw.cos()}, -1);
}

}  // namespace

Tensor RotationMatrix(const Tensor& values, const std::string& form) {
  if (form == "6d") return FromColumns(values);
  ETUDE_CHECK(form == "euler_sincos", "{}", form);
  return FromEulerSincos(values);
}

Tensor ToForm(const Tensor& rotation_6d, const std::string& form) {
  return form == "6d" ? rotation_6d : EulerSincosOf(RotationMatrix(rotation_6d, "6d"));
}

Tensor To6D(const Tensor& values, const std::string& form) {
  const Tensor R = RotationMatrix(values, form);
  return torch::cat({R.select(-1, 0), R.select(-1, 1)}, -1);
}

Tensor AngleDegrees(const Tensor& said, const std::string& form, const Tensor& label_6d) {
  const Tensor trace = (RotationMatrix(said, form) * RotationMatrix(label_6d, "6d")).sum({-2, -1});
  return torch::rad2deg(torch::acos(((trace - 1) / 2).clamp(-1, 1)));
}

Tensor WithRotation(const Tensor& values, int first, const Tensor& rotation) {
  const auto rest = values.size(-1) - first - 6;
  return torch::cat({values.narrow(-1, 0, first), rotation, values.narrow(-1, first + 6, rest)}, -1);
}

}  // namespace etude::policy
