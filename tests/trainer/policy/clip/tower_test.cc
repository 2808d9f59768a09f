// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/clip/tower.cc
#include "trainer/policy/clip/tower.h"

#include <gmock/gmock.h>

#include "tests/support/matchers.h"
#include "tests/trainer/policy/clip/reference_tower.h"
#include "tests/trainer/policy/clip/tiny_clip.h"

namespace etude::clip {
namespace tower_test {

using Ids = std::vector<std::int64_t>;

const Ids kSentence{62, 61, 58, 2, 20, 41, 63};  // "pick the cup"
constexpr std::int64_t kEnd = 6;

Tower Open(const store::Safetensors& model, const std::string& config = "") {
  const auto sizes = SizesOf(model, config);
  EXPECT_THAT(sizes, IsOk());
  auto tower = Tower::Create(model, *sizes);
  EXPECT_THAT(tower, IsOk());
  return std::move(*tower);
}

TEST(Tower, AgreesWithAnIndependentImplementation) {
  at::set_num_threads(1);
  struct Case {
    TinyShape shape;
    std::string config;
    std::size_t heads;
  };
  const std::vector<Case> cases{
      {{.width = 64, .layers = 1}, "", 1},
      {{}, "", 2},
      {{.width = 192, .layers = 3, .hidden = 64, .output = 7}, "", 3},
      {{}, R"({"num_attention_heads": 8})", 8},
      {{.type = store::DType::kF16}, "", 2},
  };
  for (const Case& item : cases) {
    const store::Safetensors model = TinyModel(item.shape, 5);
    const Tower tower = Open(model, item.config);
    const ReferenceTower reference(model, static_cast<std::size_t>(item.shape.layers), item.heads);
    for (const Ids& ids : {kSentence, Ids{62, 63}, Ids{62, 0, 0, 25, 51, 54, 55, 63}}) {
      const torch::Tensor mine = tower.Embed(ids, static_cast<std::int64_t>(ids.size()) - 1);
      ASSERT_EQ(mine.sizes(), torch::IntArrayRef({item.shape.output}));
      EXPECT_EQ(mine.scalar_type(), torch::kFloat32);
      EXPECT_FALSE(mine.requires_grad());
      EXPECT_GT(mine.abs().max().item<float>(), 0.1) << "a comparison of nothing";
      EXPECT_LT(LargestDifference(mine, reference.Embed(ids)), 1e-4)
          << "width " << item.shape.width << ", heads " << item.heads << ", " << ids.size() << " tokens";
    }
  }
}

TEST(Tower, ReadsBrainFloats) {
  const store::Safetensors whole = TinyModel(), brain = TinyModel({.type = store::DType::kBF16});
  const torch::Tensor a = Open(whole).Embed(kSentence, kEnd), b = Open(brain).Embed(kSentence, kEnd);
  EXPECT_GT((a - b).norm().item<float>(), 0);
  EXPECT_LT((a - b).norm().item<float>(), 0.1 * a.norm().item<float>()) << "8 bits of each weight are left";
}

TEST(Tower, NothingBehindTheEndTokenMatters) {
  const Tower tower = Open(TinyModel());
  Ids padded = kSentence;
  padded.insert(padded.end(), {63, 5, 63, 63});
  const torch::Tensor a = tower.Embed(kSentence, kEnd), b = tower.Embed(padded, kEnd);
  EXPECT_LT((a - b).abs().max().item<float>(), 1e-4);
  // and everything before it does, by its place too
  const Ids turned{62, 58, 61, 2, 20, 41, 63};
  EXPECT_GT((a - tower.Embed(turned, kEnd)).abs().max().item<float>(), 1e-2);
}

TEST(Tower, IsReadyForTheLongestSentence) {
  const Tower tower = Open(TinyModel({.positions = 9}));
  EXPECT_TRUE(tower.Embed({62, 1, 2, 3, 4, 5, 6, 7, 63}, 8).isfinite().all().item<bool>());
}

TEST(IsOfTower, LeavesThePictureOut) {
  EXPECT_TRUE(IsOfTower("text_model.embeddings.token_embedding.weight"));
  EXPECT_TRUE(IsOfTower("text_projection.weight"));
  for (const char* name : {"vision_model.encoder.layers.0.mlp.fc1.weight", "visual_projection.weight", "logit_scale"})
    EXPECT_FALSE(IsOfTower(name)) << name;
}

TEST(SizesOf, AreThoseOfTheTensorsWithoutAConfiguration) {
  const auto sizes = SizesOf(TinyModel({.width = 128, .layers = 3, .hidden = 96, .positions = 20, .output = 5}), "");
  ASSERT_THAT(sizes, IsOk());
  EXPECT_EQ(sizes->vocabulary, 64);
  EXPECT_EQ(sizes->positions, 20);
  EXPECT_EQ(sizes->width, 128);
  EXPECT_EQ(sizes->hidden, 96);
  EXPECT_EQ(sizes->layers, 3);
  EXPECT_EQ(sizes->heads, 2);
  EXPECT_EQ(sizes->output, 5);
}

TEST(SizesOf, AreThoseOfTheConfigurationWhereItSaysThem) {
  const store::Safetensors model = TinyModel();
  // as of a whole model, with another number for the picture
  const auto nested = SizesOf(model, R"({"projection_dim": 512, "vision_config": {"num_attention_heads": 12},
      "text_config": {"hidden_size": 128, "num_attention_heads": 4, "num_hidden_layers": 1, "hidden_act": "quick_gelu",
                      "layer_norm_eps": 1e-05, "vocab_size": null}})");
  ASSERT_THAT(nested, IsOk());
  EXPECT_EQ(nested->heads, 4);
  EXPECT_EQ(nested->layers, 1);
  EXPECT_EQ(nested->vocabulary, 64);
  EXPECT_EQ(nested->output, 48);
  // as of a text model
  const auto flat = SizesOf(model, R"({"num_attention_heads": 8, "intermediate_size": 192})");
  ASSERT_THAT(flat, IsOk());
  EXPECT_EQ(flat->heads, 8);
}

TEST(SizesOf, RefusesWhatIsNotThisTower) {
  const store::Safetensors model = TinyModel();
  const auto refused = [&](const store::Safetensors& tensors, const std::string& config, const char* reason) {
    const auto sizes = SizesOf(tensors, config);
    EXPECT_THAT(sizes, HasCode(Code::kCorrupt));
    EXPECT_THAT(sizes, MessageHas(reason));
  };
  refused(model, "[]", "config.json is not a JSON map");
  refused(model, R"({"text_config": {"hidden_act": "gelu"}})", "hidden_act is \"gelu\"");
  refused(model, R"({"layer_norm_eps": 1e-3})", "layer_norm_eps");
  refused(model, R"({"hidden_size": "wide"})", "'hidden_size' is \"wide\"");
  refused(model, R"({"hidden_size": -1})", "'hidden_size' is -1");
  refused(model, R"({"num_hidden_layers": 18446744073709551615})", "more than");
  refused(model, R"({"num_attention_heads": 3})", "num_attention_heads");
  refused(TinyModel({.width = 96}), "", "num_attention_heads");
  const auto without = [&](const std::string& name) {
    store::Safetensors tensors = model;
    tensors.tensors.erase(name);
    return tensors;
  };
  for (const char* name :
       {"text_model.embeddings.token_embedding.weight", "text_model.embeddings.position_embedding.weight",
        "text_model.encoder.layers.0.mlp.fc1.weight", "text_projection.weight"})
    refused(without(name), "", name);
  refused(store::Safetensors{}, "", "is missing");
}

TEST(Tower, RefusesTensorsByTheirNames) {
  const TowerSizes sizes = *SizesOf(TinyModel(), "");
  const auto refused = [&](auto change, const char* reason) {
    store::Safetensors model = TinyModel();
    change(model.tensors);
    const auto tower = Tower::Create(model, sizes);
    EXPECT_THAT(tower, HasCode(Code::kCorrupt));
    EXPECT_THAT(tower, MessageHas(reason));
  };
  const std::string second = "text_model.encoder.layers.1.";
  for (const auto& [name, tensor] : TinyModel().tensors)
    refused([&, &name = name](auto& all) { all.erase(name); }, ("'" + name + "' is missing").c_str());
  refused(
      [&](auto& all) {
        all.at(second + "mlp.fc2.bias").shape = {64, 2};
      },
      "'text_model.encoder.layers.1.mlp.fc2.bias' is [64, 2], not [128]");
  refused([&](auto& all) { all.at(second + "self_attn.q_proj.weight").shape = {16384}; },
          "q_proj.weight' is [16384], not [128, 128]");
  refused(
      [&](auto& all) {
        all.at(second + "layer_norm1.bias") = {store::DType::kI64, {128}, {}};
      },
      "layer_norm1.bias' is I64, not F32, F16 or BF16");
  refused([&](auto& all) { all.clear(); }, "; and ");
  // the configuration asks for more than there is
  TowerSizes deeper = sizes;
  deeper.layers = 3;
  EXPECT_THAT(Tower::Create(TinyModel(), deeper), MessageHas("'text_model.encoder.layers.2.layer_norm1.weight'"));
}

}  // namespace tower_test
}  // namespace etude::clip
