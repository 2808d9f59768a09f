// SPDX-License-Identifier: Apache-2.0
// The network: image, language and joint tokens, and a graph of modules whose registers attend to
// them. Shapes: B images, S sentences per image (relabelled grounding asks several targets of one
// picture), P image tokens, d width, J joints, D distinct sentences of the batch (each is encoded
// once).
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "services/core/result.h"
#include "trainer/policy/clip/text_encoder.h"
#include "trainer/policy/config.h"
#include "trainer/policy/quantities/output.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

struct Inputs {
  torch::Tensor images;       ///< (B, 3, h, w) uint8, channels-last; the configured crop, maybe jittered
  torch::Tensor crop_origin;  ///< (B, 2) float: u0, v0 of each picture in the camera's picture, px
  /// (B, kViewpointSize) float, of each picture's camera (services/episode/viewpoint.h). Of policies that read it alone
  /// (ReadsCamera of names.h).
  torch::Tensor viewpoint;
  torch::Tensor joints;                ///< (B, J) float, raw: arm joints then gripper joints
  std::vector<std::string> sentences;  ///< D distinct sentences
  torch::Tensor token_ids;             ///< instead of sentences, of one (LanguageEncoder::ForwardIds)
  torch::Tensor sentence_index;        ///< (B, S) int64 into `sentences`; s = 0 is the demonstrated command
  /// (R, 4) float: u0, v0, width, height, px from the crop's corner, of what no module attends to; undefined: nothing.
  torch::Tensor unattended;
};

/// Labels by name, "target.position" (see trainer/data/labels.h); (B, S, ...) or (B, 1, ...) where the sentence does
/// not matter. A bool tensor "<name>.valid" of shape (B, S|1) masks samples.
using Labels = std::map<std::string, torch::Tensor>;

struct LossTerms {
  torch::Tensor total;                  ///< scalar
  std::map<std::string, double> terms;  ///< "LANG.attention", "TAR3D.decode", ...; they sum to total
};

/// Called with each module's name and output before any later module reads it; what it changes, they read.
using Intervention = std::function<void(const std::string&, ModuleOutput&)>;

/// Thread safety: forward in eval mode under NoGradGuard from several threads; training from one.
class Policy : public torch::nn::Module {
 public:
  /// @param text_encoder  of a policy whose language is clip:DIR: that folder, open; none: it is opened here
  /// @error kInvalidArgument from config.Validate(); what is not resolved; a folder whose content is another; as
  /// clip::TextEncoder::Open
  static Result<std::shared_ptr<Policy>> Create(const PolicyConfig& config, const Normalization& normalization,
                                                std::uint64_t seed,
                                                std::shared_ptr<clip::TextEncoder> text_encoder = nullptr);
  ~Policy() override;

  const PolicyConfig& config() const;
  /// The tokens of sentences, (D, d): what Forward computes for inputs.sentences.
  torch::Tensor EncodeSentences(const std::vector<std::string>& sentences);
  /// Whether Forward can read it: c10::Error of it otherwise. @error kInvalidArgument: why not
  Status CheckSentence(const std::string& sentence) const;
  /// Evaluates the modules of level <= `level` (all when 0).
  Outputs Forward(const Inputs& inputs, int level = 0, const Intervention& intervene = {});
  /// Losses of every module of level <= `level` that `outputs` holds. A label that is absent adds
  /// nothing.
  LossTerms Loss(const Inputs& inputs, const Outputs& outputs, const Labels& labels, int level = 0);

  /// Where its parameters lie, and where it computes: the CPU at first, `to(device)` moves it. Inputs may lie anywhere;
  /// outputs are there, and labels have to be.
  torch::Device device() const;
  int levels() const;
  /// Numbers of Inputs::joints, J.
  int joints() const;
  /// What attention's columns are: "image" stands for all image tokens, then language, joints,
  /// self, modules. `module` is one of config().modules.
  std::vector<std::string> KeysOf(const std::string& module) const;
  /// Row-major grid of image tokens: rows, columns.
  std::pair<int, int> grid() const;
  /// Name -> parameter or buffer, normalisation included: what a checkpoint stores.
  std::map<std::string, torch::Tensor> StateTensors();
  /// @error kInvalidArgument with every name or shape that does not fit; the policy is unchanged
  /// then.
  Status LoadStateTensors(const std::map<std::string, torch::Tensor>& tensors);
  /// Parameters that belong to a part (parts.h). With shared attention a module's are its register and decoder.
  std::vector<std::string> ParametersOf(const std::string& part) const;
  /// Parts that stay as they are from now on, bit for bit: no gradients, and running statistics that only serve.
  void Freeze(const std::vector<std::string>& parts);
  const std::set<std::string>& frozen() const;
  void train(bool on = true) override;

 private:
  struct Impl;
  explicit Policy(std::unique_ptr<Impl> impl);
  // what makes the network, in this order: it is the order in which weights are drawn
  void RegisterNormalization();
  void RegisterEncoders();
  void RegisterModules();
  void RegisterSegments();
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::policy
