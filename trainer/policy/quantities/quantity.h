// SPDX-License-Identifier: Apache-2.0
// What a module can say about an entity: one type for each quantity, one file for each type. A quantity owns its width,
// unit, label, decoding, loss, metrics and words; to add one, write its file and name it in quantity.cc.
// Shapes as in output.h. Torch's tensors are only declared here, so that what checks a policy's file needs no torch.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "services/core/config.h"
#include "trainer/data/labels.h"
#include "trainer/policy/quantities/losses.h"

namespace at {
class Tensor;
}

namespace etude::policy {

struct ModuleOutput;
struct Normalization;
struct Target;
struct Metric;

/// The form of a decoder's last layer.
struct Head {
  std::string readout = "linear";
  std::string rotation = "6d";       ///< 6d | euler_sincos, see rotation.h
  std::vector<std::string> classes;  ///< nouns or tasks, in the order of the logits
};

/// What a decoder reads besides the network's numbers.
struct Decoding {
  const Normalization& normalization;
  int stride = 1;  ///< px from one image token to the next
  /// Of the modules it is decoded from, (B, S' | 1, 3) m: the position (relative), the difference of two (difference).
  /// Of the module that is corrected (B, S' | 1, kWaypoints, kWaypointSize).
  /// (B, S', 6): where the camera is (m), and the direction in world of the pixel (ray), as viewpoint.h has it.
  const at::Tensor* from = nullptr;
};

/// The part of the camera's picture that the policy sees.
struct PictureView {
  const at::Tensor& crop_origin;  ///< (B, 2) px
  int width = 0, height = 0;      ///< px
};

class Quantity : public data::LabelRule {
 public:
  std::string_view name() const { return name_; }        ///< "position"
  std::string_view unit() const { return unit_; }        ///< of its value: "m", "px", "-"
  std::string_view meaning() const { return meaning_; }  ///< one line for people

  /// Beside linear and mlp, which every quantity has.
  virtual std::vector<std::string> own_readouts() const { return {}; }
  /// Whether it may be asked of `entity`.
  virtual bool IsOf(const data::Entity& entity) const { return entity.is_thing(); }
  /// Whether a module that decodes it knows the `other` quantity too (a pose has a position).
  virtual bool Implies(std::string_view other) const { return other == name(); }

  /// Numbers that the network says.
  virtual int width(const Head& head) const = 0;
  /// Whether the last layer starts at zero: what it adds to is a good first answer.
  virtual bool starts_at_zero(const Head&) const { return false; }
  /// Puts ModuleOutput::decoded[name()], from `raw` (B, S', width).
  virtual void Decode(const Head& head, const Decoding& decoding, const at::Tensor& raw,
                      ModuleOutput& output) const = 0;

  /// Of Normalization what decoding, or reading it as a plain feature, scales by: position, displacement, offset.
  virtual std::vector<std::string> statistics(const Head&) const { return {}; }

  /// As input of another module's decoder: numbers, 0 when it is none; with `fourier` as Fourier features.
  virtual int feature_width(const Head&, bool /*fourier*/) const { return 0; }
  /// (B, S', feature_width), normalised. @param detach  no gradient goes back. @pre feature_width > 0
  virtual at::Tensor Feature(const ModuleOutput& output, const Normalization& normalization, bool fourier,
                             bool detach) const;

  /// A scalar. Samples without label, or out of `view` where that matters, do not count.
  virtual at::Tensor Loss(const Head& head, const LossesConfig& losses, const ModuleOutput& output,
                          const Target& target, const PictureView& view) const = 0;
  virtual std::vector<Metric> Measure(const Head& head, const ModuleOutput& output, const Target& target) const = 0;
  /// Adds to `words` what the first sample's first sentence is answered, for people and for other programs: "value", in
  /// unit(), rotations in 6D.
  virtual void Say(const Head& head, const ModuleOutput& output, OrderedJson& words) const = 0;

 protected:
  Quantity(std::string_view name, std::string_view unit, std::string_view meaning)
      : name_(name), unit_(unit), meaning_(meaning) {}

 private:
  std::string_view name_, unit_, meaning_;
};

/// nullptr: no such quantity.
const Quantity* FindQuantity(std::string_view name);
const std::vector<std::string>& QuantityNames();

}  // namespace etude::policy
