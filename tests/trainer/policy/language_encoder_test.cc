// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/language_encoder.cc, and what a policy makes of it
#include "trainer/policy/language_encoder.h"

#include <gmock/gmock.h>
#include <torch/optim/sgd.h>

#include <set>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/policy/clip/clip_policy.h"
#include "tests/trainer/policy/clip/reference_tower.h"
#include "trainer/policy/parts.h"
#include "trainer/policy/policy.h"

namespace etude::policy {
namespace language_encoder_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<std::string> NamesOf(const std::map<std::string, torch::Tensor>& tensors, const std::string& part) {
  std::vector<std::string> names;
  for (const auto& [name, tensor] : tensors)
    if (PartOfTensor(name) == part) names.push_back(name);
  return names;
}

class ClipPolicyTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    clip::WriteTinyClip(folder_.path(), model_);
    config_ = WithClip(folder_.path());
  }

  const store::Safetensors model_ = clip::TinyModel();
  TemporaryFolder folder_;
  PolicyConfig config_;
};

TEST(TrainedLanguageEncoder, ReadsAnySentenceAndKeepsItsNames) {
  const auto policy = MakePolicy(TinyConfig());
  EXPECT_THAT(policy->CheckSentence(std::string(10'000, 'a')), IsOk());
  EXPECT_THAT(
      NamesOf(policy->StateTensors(), "language"),
      ElementsAre("language.mlp.layer0.bias", "language.mlp.layer0.weight", "language.mlp.layer1.bias",
                  "language.mlp.layer1.weight", "language.norm.bias", "language.norm.weight", "language.vectors"));
}

PolicyConfig WithSenses(const std::string& encoder) {
  PolicyConfig config = TinyConfig();
  config.language.encoder = encoder;
  config.language.senses = true;
  config.language.sha256 = language::Senses::Open().value()->sha256();
  return config;
}

TEST(TrainedLanguageEncoder, HasRowsForSenses) {
  const auto config = WithSenses("default");
  const auto vectors = MakePolicy(config)->StateTensors().at("language.vectors");
  EXPECT_EQ(vectors.size(0), config.language.buckets + language::kSenseBuckets);
}

// With nothing learned of spellings, words are what they mean: "flask" and "decanter" have most of it in common.
TEST(TrainedLanguageEncoder, ReadsWhatWordsMean) {
  for (const char* encoder : {"default", "conv"}) {
    const auto config = WithSenses(encoder);
    const auto policy = MakePolicy(config);
    const torch::NoGradGuard no_grad;
    policy->StateTensors().at("language.vectors").narrow(0, 0, config.language.buckets).zero_();
    policy->eval();
    const torch::Tensor said = policy->EncodeSentences({"flask", "decanter", "naan"});
    EXPECT_LT((said[0] - said[1]).norm().item<double>(), 0.7 * (said[0] - said[2]).norm().item<double>()) << encoder;
  }
}

TEST(TrainedLanguageEncoder, LeavesSpellingsOutInTrainingAlone) {
  const auto policy = MakePolicy(WithSenses("default"));
  const torch::NoGradGuard no_grad;
  std::vector<std::string> sentences;
  for (const char* verb : {"push", "lift", "move", "take", "raise"})
    for (const char* noun : {"bottle", "can", "box", "bread"}) sentences.push_back(std::string(verb) + " " + noun);
  policy->eval();
  const torch::Tensor whole = policy->EncodeSentences(sentences);
  EXPECT_TRUE(whole.equal(policy->EncodeSentences(sentences)));
  policy->train();
  const torch::Tensor trained = policy->EncodeSentences(sentences);
  EXPECT_TRUE(trained.equal(policy->EncodeSentences(sentences))) << "no draw";
  const auto changed = (trained != whole).any(1).sum().item<std::int64_t>();
  EXPECT_GT(changed, 2);
  EXPECT_LT(changed, static_cast<std::int64_t>(sentences.size()));
  policy->Freeze({"language"});
  EXPECT_TRUE(policy->EncodeSentences(sentences).equal(whole)) << "what is frozen answers as it does when it serves";
}

TEST(TrainedLanguageEncoder, IsNotBuiltOnAnotherWordNet) {
  PolicyConfig config = WithSenses("conv");
  config.language.sha256 = std::string(64, 'b');
  EXPECT_THAT(Policy::Create(config, TinyNormalization(), 1), MessageHas("trained with bbbbbbbbbbbb"));
  config.language.sha256.clear();
  EXPECT_THAT(Policy::Create(config, TinyNormalization(), 1), MessageHas("language.sha256 is not resolved"));
}

PolicyConfig WithConvolutions() {
  PolicyConfig config = TinyConfig();
  config.language.encoder = "conv";
  return config;
}

TEST(ConvolutionEncoder, KeepsItsNames) {
  const auto names = NamesOf(MakePolicy(WithConvolutions())->StateTensors(), "language");
  EXPECT_THAT(names, ::testing::Contains("language.vectors"));
  EXPECT_THAT(names, ::testing::Contains("language.convolution1.weight"));
  EXPECT_THAT(names, ::testing::SizeIs(7 + 4));
}

TEST(ConvolutionEncoder, SaysTheSameOfASentenceWhateverIsBesideIt) {
  at::set_num_threads(1);
  const auto policy = MakePolicy(WithConvolutions());
  const std::vector<std::string> sentences{"push it", "put the red cube to the left of the blue mug", "", "push it"};
  const torch::Tensor together = policy->EncodeSentences(sentences);
  for (std::size_t i = 0; i < sentences.size(); ++i)
    EXPECT_LT(MaxDifference(policy->EncodeSentences({sentences[i]})[0], together[static_cast<std::int64_t>(i)]), 1e-5F)
        << sentences[i];
  EXPECT_TRUE(torch::equal(together[0], together[3]));
}

// Without pairs of neighbours, which a sentence turned round does not keep either: what the order of three words says
// is known to whom looks at what is beside a word.
TEST(ConvolutionEncoder, KnowsTheOrderOfWords) {
  at::set_num_threads(1);
  using Words = std::vector<std::vector<std::int64_t>>;
  const auto apart = [](const PolicyConfig& config) {
    LanguageConfig language = config.language;
    torch::manual_seed(3);
    std::unique_ptr<LanguageEncoder> encoder;
    if (language.encoder == "conv")
      encoder = std::make_unique<ConvolutionEncoder>(language, nullptr, 8, "silu", LanguageEncoder::Output::kLinear);
    else
      encoder = std::make_unique<BagOfWordsEncoder>(language, nullptr, 8, "silu", LanguageEncoder::Output::kLinear);
    const auto ids = [](const Words& words) {
      std::vector<std::int64_t> flat;
      for (const auto& word : words) flat.insert(flat.end(), word.begin(), word.end());
      return torch::tensor(flat, torch::kInt64).view({static_cast<std::int64_t>(words.size()), -1});
    };
    const torch::Tensor said = encoder->ForwardIds(ids({{1, 2}, {3, -1}, {4, 5}}));
    // rows of nothing say nothing, wherever they are
    EXPECT_LT(MaxDifference(encoder->ForwardIds(ids({{-1, -1}, {1, 2}, {-1, -1}, {3, -1}, {4, 5}, {-1, -1}})), said),
              1e-5F);
    return MaxDifference(said, encoder->ForwardIds(ids({{4, 5}, {3, -1}, {1, 2}})));
  };
  EXPECT_GT(apart(WithConvolutions()), 1e-3F);
  EXPECT_LT(apart(TinyConfig()), 1e-5F) << "a bag of words does not";
}

TEST_F(ClipPolicyTest, HoldsNothingOfClipButTheProjection) {
  const auto policy = MakePolicy(config_);
  EXPECT_THAT(NamesOf(policy->StateTensors(), "language"),
              ElementsAre("language.norm.bias", "language.norm.weight", "language.projection.bias",
                          "language.projection.weight"));
  EXPECT_EQ(policy->StateTensors().at("language.projection.weight").sizes(), torch::IntArrayRef({8, 48}));
  EXPECT_THAT(policy->ParametersOf("language"), ::testing::SizeIs(4));
  // every other name is that of the same policy without it
  std::set<std::string> mine, plain;
  for (const auto& [name, tensor] : policy->StateTensors())
    if (PartOfTensor(name) != "language") mine.insert(name);
  for (const auto& [name, tensor] : MakePolicy(TinyConfig())->StateTensors())
    if (PartOfTensor(name) != "language") plain.insert(name);
  EXPECT_EQ(mine, plain);
}

TEST_F(ClipPolicyTest, TokensAreTheProjectionOfWhatTheTowerSays) {
  // the original's: a linear map and no more
  config_.attention = "shared";
  const auto policy = MakePolicy(config_);
  const auto state = policy->StateTensors();
  EXPECT_FALSE(state.contains("language.norm.weight"));
  const auto embedding = clip::ReferenceTower(model_, 2, 2).Embed({62, 61, 58, 2, 20, 41, 63});
  const torch::Tensor tokens = policy->EncodeSentences({"pick the cup", "pick"});

  ASSERT_EQ(tokens.sizes(), torch::IntArrayRef({2, 8}));
  const torch::Tensor mapped =
      torch::mv(state.at("language.projection.weight").to(torch::kFloat64), torch::tensor(embedding, torch::kFloat64)) +
      state.at("language.projection.bias");
  EXPECT_LT((tokens[0] - mapped).abs().max().item<double>(), 1e-4);
  EXPECT_GT(MaxDifference(tokens[0], tokens[1]), 1e-2F);
}

TEST_F(ClipPolicyTest, LearnsTheProjectionAndNothingOfTheTower) {
  // remembers one sentence only, so that what is asked for twice is computed twice
  const auto text_encoder = clip::TextEncoder::Open(folder_.path(), config_.language.sha256, 1).value();
  const auto policy = Policy::Create(config_, TinyNormalization(), 1, text_encoder).value();
  const torch::Tensor before = text_encoder->Embed({"pick the cup"});
  const auto files = ReadBinaryFile(folder_ / "model.safetensors").value();
  const torch::Tensor projection = policy->StateTensors().at("language.projection.weight").detach().clone();
  const auto inputs = MakeInputs(config_, 4, 2);
  const auto labels = MakeLabels(config_, 4, 2);

  torch::optim::SGD optimizer(policy->parameters(), 0.01);
  for (int step = 0; step < 3; ++step) {
    optimizer.zero_grad();
    policy->Loss(inputs, policy->Forward(inputs), labels).total.backward();
    optimizer.step();
  }

  EXPECT_GT(MaxDifference(policy->StateTensors().at("language.projection.weight"), projection), 0);
  const auto computed = text_encoder->computed();
  EXPECT_TRUE(torch::equal(text_encoder->Embed({"pick the cup"}), before));
  EXPECT_EQ(text_encoder->computed(), computed + 1) << "the weights were asked, not the memory";
  EXPECT_EQ(ReadBinaryFile(folder_ / "model.safetensors").value(), files);
}

TEST_F(ClipPolicyTest, SaysWhatItCannotRead) {
  const auto policy = MakePolicy(config_);
  std::string longer;
  for (int i = 0; i < 80; ++i) longer += "a ";
  EXPECT_THAT(policy->CheckSentence("pick the cup"), IsOk());
  EXPECT_THAT(policy->CheckSentence(longer), MessageHas("82 tokens"));
  EXPECT_THROW(policy->EncodeSentences({longer}), c10::Error);
}

TEST_F(ClipPolicyTest, IsNotBuiltWithoutItsFolder) {
  const auto refused = [](const PolicyConfig& config, const std::string& reason) {
    const auto policy = Policy::Create(config, TinyNormalization(), 1);
    ASSERT_FALSE(policy);
    EXPECT_THAT(policy.error().message, HasSubstr(reason));
  };
  PolicyConfig config = config_;
  config.language.encoder = "clip:/nowhere";
  refused(config, "/nowhere");
  config = config_;
  config.language.sha256 = std::string(64, 'c');
  refused(config, "trained with cccccccccccc");
  config.language.sha256.clear();
  refused(config, "language.sha256 is not resolved");

  // nor with another one that happens to be open
  clip::WriteTinyClip(folder_ / "other", clip::TinyModel({}, 2));
  const auto other = clip::TextEncoder::Open(folder_ / "other").value();
  const auto policy = Policy::Create(config_, TinyNormalization(), 1, other);
  ASSERT_FALSE(policy);
  EXPECT_EQ(policy.error().code, Code::kInvalidArgument);
  EXPECT_THAT(policy.error().message, HasSubstr(other->sha256().substr(0, 12)));
  // a policy that needs none does not care
  EXPECT_THAT(Policy::Create(TinyConfig(), TinyNormalization(), 1, other), IsOk());
}

}  // namespace language_encoder_test
}  // namespace etude::policy
