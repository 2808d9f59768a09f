// SPDX-License-Identifier: Apache-2.0
// One module of the graph: a query attends to tokens and registers; the result is its register, and
// its decoder turns that and what else the module may read into numbers for people. Shapes as in
// policy.h; every tensor of a module is (B, S | 1, ...).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "trainer/policy/attention.h"
#include "trainer/policy/decoder.h"
#include "trainer/policy/image_encoder.h"
#include "trainer/policy/layers.h"
#include "trainer/policy/names.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"

namespace etude::policy {

/// A token as key and as value; the same tensor twice unless attention is shared.
struct Token {
  torch::Tensor key, value;
};

/// What the encoders made of the inputs.
struct Tokens {
  Token image;                     ///< (B, P, d); undefined when no module reads it through the shared encoder
  Token language;                  ///< (B, S, d)
  Token joints;                    ///< (B, 1, d)
  torch::Tensor sentence;          ///< (B, S, d) the language token before key and value heads
  torch::Tensor joint_values;      ///< (B, 1, J) normalised
  torch::Tensor joint_token;       ///< (B, 1, d) the joint token before key and value heads
  torch::Tensor picture;           ///< (B, 3, h, w) uint8, what encoders of modules' own see
  torch::Tensor image_pixels;      ///< (P, 2) px from the crop's corner
  torch::Tensor image_unattended;  ///< (P) bool: nobody attends to them; undefined: to none of them
  torch::Tensor crop_origin;       ///< (B, 2) px
  torch::Tensor viewpoint;         ///< (B, kViewpointSize); undefined: not said
};

/// Where a module stands among the others; indices are in the order of evaluation.
struct Wiring {
  std::vector<std::string> reads;    ///< resolved, image first
  std::map<std::string, int> index;  ///< of every earlier module
  std::vector<const ModuleConfig*> earlier;
  bool depends_on_sentence = false;
  bool first_sentence_only = false;  ///< while training: a trajectory that no others but such read
};

/// The paper's parameters that modules share: heads of tokens, one attention a level.
struct SharedAttention {
  std::map<std::string, torch::Tensor> segments;  ///< (d) each: image, joints, language, modules with own registers
  std::map<int, std::shared_ptr<Attention>> levels;
};

/// (B, 1, 2J) sine and cosine of each joint's angle. @param values  (B, 1, J) normalised
torch::Tensor JointFeatures(const torch::Tensor& values, const Normalization& normalization);

class GraphModule : public torch::nn::Module {
 public:
  GraphModule(const PolicyConfig& policy, const ModuleConfig& config, Wiring wiring, const Normalization& normalization,
              const TokenGrid& grid);

  ModuleOutput Forward(const Tokens& tokens, const std::vector<ModuleOutput>& earlier, const SharedAttention* shared);
  const ModuleConfig& config() const { return config_; }
  const Wiring& wiring() const { return wiring_; }
  bool reads_image() const { return wiring_.reads[0] == "image"; }
  ImageEncoder* own_image() const { return own_image_.get(); }  ///< nullptr: it reads the shared one's tokens, or none

 private:
  struct Context;
  void RegisterSegments();
  void MakeDecoder(const PolicyConfig& policy);
  torch::Tensor Query(const Context& context);
  Keys CollectKeys(const Context& context);
  Token ImageToken(const Tokens& tokens);
  Token TokenOf(const std::string& name, const Context& context);
  Token OwnToken(const Context& context, bool as_key);
  torch::Tensor Feature(const DecoderInput& input, const Context& context, const ModuleOutput& own) const;
  void Decode(const Context& context, ModuleOutput& output);
  torch::Tensor From(const Context& context) const;
  torch::Tensor RayOf(const Context& context) const;
  /// Of an earlier module.
  const ModuleOutput& OutputOf(const std::string& module, const Context& context) const;
  torch::Tensor RegisterOf(const std::string& module, const Context& context) const;

  ModuleConfig config_;
  Wiring wiring_;
  Normalization normalization_;  ///< handles of the policy's buffers
  int width_, stride_;
  Head head_;
  const Quantity* quantity_;             ///< nullptr: no decoder
  torch::Tensor register_;               ///< (d) own query, unless the query is another module's register
  std::vector<torch::Tensor> segments_;  ///< (d) of each key but the image: which is which; own attention only
  std::shared_ptr<TokenHead> query_head_, key_head_, value_head_;  ///< shared attention only
  std::shared_ptr<Attention> attention_;                           ///< own attention only
  std::shared_ptr<LayerNorm> norm_;                                ///< own attention only
  std::shared_ptr<ImageEncoder> own_image_;
  std::vector<DecoderInput> inputs_;
  std::shared_ptr<Decoder> decoder_;
};

}  // namespace etude::policy
