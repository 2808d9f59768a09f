// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/clip/text_encoder.cc
#include "trainer/policy/clip/text_encoder.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <thread>

#include "services/core/hash.h"
#include "tests/support/matchers.h"
#include "tests/support/replace_in_file.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/policy/clip/reference_tower.h"
#include "tests/trainer/policy/clip/tiny_clip.h"

namespace etude::clip {
namespace text_encoder_test {

std::shared_ptr<TextEncoder> MustOpen(const Path& folder, std::size_t remembered = TextEncoder::kRemembered) {
  auto encoder = TextEncoder::Open(folder, "", remembered);
  EXPECT_THAT(encoder, IsOk());
  return encoder ? *encoder : nullptr;
}

class TextEncoderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    WriteTinyClip(folder_.path(), model_);
  }
  std::string HashNow() const { return MustOpen(folder_.path())->sha256(); }

  const store::Safetensors model_ = TinyModel();
  const ReferenceTower reference_{model_, 2, 2};
  TemporaryFolder folder_;
};

TEST_F(TextEncoderTest, SaysOfASentenceWhatTheTowerSaysOfItsTokens) {
  const auto encoder = MustOpen(folder_.path());
  ASSERT_EQ(encoder->width(), 48);

  const torch::Tensor rows = encoder->Embed({"Pick the cup", "pick!", ""});

  ASSERT_EQ(rows.sizes(), torch::IntArrayRef({3, 48}));
  EXPECT_FALSE(rows.requires_grad());
  EXPECT_LT(LargestDifference(rows[0], reference_.Embed({62, 61, 58, 2, 20, 41, 63})), 1e-4);
  EXPECT_LT(LargestDifference(rows[1], reference_.Embed({62, 61, 54, 63})), 1e-4);
  EXPECT_LT(LargestDifference(rows[2], reference_.Embed({62, 63})), 1e-4);
  EXPECT_EQ(encoder->Embed({}).sizes(), torch::IntArrayRef({0, 48}));
}

// as CLIP has it: the state that is read out is that of the first end token
TEST_F(TextEncoderTest, WhatTheVocabularyLacksEndsTheSentence) {
  const torch::Tensor rows = MustOpen(folder_.path())->Embed({"pick ? cup"});
  EXPECT_LT(LargestDifference(rows[0], reference_.Embed({62, 61, 63})), 1e-4);
}

TEST_F(TextEncoderTest, OpensHalfPrecisionBesideThePictureAndWithAConfiguration) {
  store::Safetensors model = TinyModel({.type = store::DType::kF16});
  const ReferenceTower reference(model, 2, 4);
  model.tensors["vision_model.embeddings.class_embedding"] = {store::DType::kF16, {3}, {1, 2, 3, 4, 5, 6}};
  model.tensors["logit_scale"] = {store::DType::kF32, {}, {0, 0, 128, 63}};
  model.tensors["text_model.embeddings.position_ids"] = {store::DType::kI64, {1, 1}, std::vector<std::uint8_t>(8)};
  const Path folder = folder_ / "whole";
  WriteTinyClip(folder, model);
  ASSERT_TRUE(WriteFileAtomically(folder / "config.json", R"({"text_config": {"num_attention_heads": 4}})"));

  const auto encoder = MustOpen(folder);

  EXPECT_LT(LargestDifference(encoder->Embed({"the cup"})[0], reference.Embed({62, 58, 2, 20, 41, 63})), 1e-4);
}

// what a person can compute with sha256sum
TEST_F(TextEncoderTest, HashIsOfTheFilesAndTheHeads) {
  std::string listing;
  for (const char* file : {"merges.txt", "model.safetensors", "vocab.json"})
    listing += Sha256Hex(ReadTextFile(folder_ / file).value()) + "  " + file + "\n";
  EXPECT_EQ(HashNow(), Sha256Hex(listing + "heads 2\n"));

  const std::string before = HashNow();
  ASSERT_TRUE(WriteFileAtomically(folder_ / "config.json", R"({"num_attention_heads": 2})"));
  EXPECT_EQ(HashNow(), before) << "it says nothing new";
  ASSERT_TRUE(WriteFileAtomically(folder_ / "config.json", R"({"num_attention_heads": 4})"));
  EXPECT_NE(HashNow(), before);
  std::filesystem::remove(folder_ / "config.json");
  EXPECT_EQ(HashNow(), before);
  ReplaceInFile(folder_ / "merges.txt", "0.2", "0.3");
  EXPECT_NE(HashNow(), before);
  ReplaceInFile(folder_ / "merges.txt", "0.3", "0.2");
  ReplaceInFile(folder_ / "vocab.json", "{", "{ ");
  EXPECT_NE(HashNow(), before);
  WriteTinyClip(folder_.path(), TinyModel({}, 2));
  EXPECT_NE(HashNow(), before);
}

TEST_F(TextEncoderTest, RefusesAFolderOfOtherContent) {
  const std::string here = HashNow(), other(64, 'a');
  EXPECT_THAT(TextEncoder::Open(folder_.path(), here), IsOk());
  const auto refused = TextEncoder::Open(folder_.path(), other);
  EXPECT_THAT(refused, HasCode(Code::kInvalidArgument));
  EXPECT_THAT(refused, MessageHas(folder_.path().string()));
  EXPECT_THAT(refused, MessageHas("its content is " + here.substr(0, 12)));
  EXPECT_THAT(refused, MessageHas("trained with aaaaaaaaaaaa: give the folder"));
}

TEST_F(TextEncoderTest, SaysWhichFileIsMissingOrWrong) {
  const auto refused = [&](const Path& folder, Code code, const std::string& reason) {
    const auto encoder = TextEncoder::Open(folder);
    EXPECT_THAT(encoder, HasCode(code));
    EXPECT_THAT(encoder, MessageHas(reason));
  };
  for (const char* file : {"model.safetensors", "vocab.json", "merges.txt"}) {
    const Path without = folder_ / ("without_" + std::string(file));
    WriteTinyClip(without);
    std::filesystem::remove(without / file);
    refused(without, Code::kNotFound, (without / file).string());
    refused(without, Code::kNotFound, "openai/clip-vit-base-patch32");
  }
  refused(folder_ / "nowhere", Code::kNotFound, "it needs model.safetensors, vocab.json and merges.txt");

  WriteTinyClip(folder_ / "short");
  ASSERT_TRUE(WriteFileAtomically(folder_ / "short/model.safetensors", "not safetensors"));
  refused(folder_ / "short", Code::kCorrupt, "safetensors");

  store::Safetensors few = TinyModel();
  auto& embedding = few.tensors.at("text_model.embeddings.token_embedding.weight");
  embedding.shape[0] = 60;
  embedding.data.resize(60 * 128 * 4);
  WriteTinyClip(folder_ / "few", few);
  refused(folder_ / "few", Code::kCorrupt, "vocab.json has an id 63, and model.safetensors embeds 60 tokens");

  WriteTinyClip(folder_ / "config");
  ASSERT_TRUE(WriteFileAtomically(folder_ / "config/config.json", R"({"hidden_act": "gelu"})"));
  refused(folder_ / "config", Code::kCorrupt, "hidden_act");
}

TEST_F(TextEncoderTest, SaysThatASentenceIsTooLong) {
  const auto encoder = MustOpen(folder_.path());
  const auto words = [](int count) {
    std::string sentence;
    for (int i = 0; i < count; ++i) sentence += "a ";
    return sentence;
  };
  EXPECT_THAT(encoder->Check(words(75)), IsOk()) << "with start and end 77";
  EXPECT_TRUE(encoder->Embed({words(75)}).isfinite().all().item<bool>());
  EXPECT_THAT(encoder->Check(words(76)), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(encoder->Check(words(76)), MessageHas("78 tokens with its start and end, CLIP reads up to 77"));
  EXPECT_THAT(encoder->Check(std::string(1025, ' ')), MessageHas("1025 bytes"));
  EXPECT_THAT(encoder->Check(std::string(1024, ' ')), IsOk());
  EXPECT_THROW(encoder->Embed({"pick", words(76)}), c10::Error);
  EXPECT_THROW(encoder->Embed({words(76)}), c10::Error) << "it was not remembered as something";
  EXPECT_EQ(encoder->Embed({"pick"}).sizes(), torch::IntArrayRef({1, 48}));
}

// a row does not depend on who asked, when, or with what beside it
TEST_F(TextEncoderTest, ComputesASentenceOnceForAllWhoAsk) {
  const std::vector<std::string> sentences{"pick the cup", "pick", "the cup", "put it down", "a", "b", "c d e"};
  const auto encoder = MustOpen(folder_.path()), alone = MustOpen(folder_.path());
  std::vector<torch::Tensor> results(4);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < results.size(); ++t)
    threads.emplace_back([&, t] {
      for (int round = 0; round < 3; ++round) results[t] = encoder->Embed(sentences);
    });
  for (auto& thread : threads) thread.join();

  EXPECT_EQ(encoder->computed(), sentences.size());
  for (const auto& result : results) EXPECT_TRUE(torch::equal(result, results[0]));
  for (std::size_t i = 0; i < sentences.size(); ++i)
    EXPECT_TRUE(torch::equal(alone->Embed({sentences[i]})[0], results[0][static_cast<std::int64_t>(i)]))
        << sentences[i];
}

TEST_F(TextEncoderTest, RemembersThoseThatWereAskedForLast) {
  const auto encoder = MustOpen(folder_.path(), 2);
  const auto computes = [&](const char* sentence) {
    const auto before = encoder->computed();
    encoder->Embed({sentence});
    return encoder->computed() > before;
  };
  EXPECT_TRUE(computes("a"));
  EXPECT_TRUE(computes("b"));
  EXPECT_FALSE(computes("a"));
  EXPECT_TRUE(computes("c")) << "in the place of b";
  EXPECT_FALSE(computes("a"));
  EXPECT_TRUE(computes("b"));
  EXPECT_TRUE(computes("c"));
  // more at once than are remembered
  EXPECT_TRUE(
      torch::equal(encoder->Embed({"a", "b", "c", "a"}), MustOpen(folder_.path())->Embed({"a", "b", "c", "a"})));
}

TEST_F(TextEncoderTest, TakesAnyBytes) {
  const auto encoder = MustOpen(folder_.path());
  for (const char* sentence : {"\xff\xfe", "ＰＩＣＫ", "🥫", "\n", "<|endoftext|>"}) {
    EXPECT_THAT(encoder->Check(sentence), IsOk());
    EXPECT_TRUE(encoder->Embed({sentence}).isfinite().all().item<bool>());
  }
}

TEST_F(TextEncoderTest, FoldersAreOpenedOnce) {
  const std::string hash = HashNow(), place = folder_.path().string();
  Folders folders;
  const auto first = folders.Open(place, hash);
  ASSERT_THAT(first, IsOk());
  EXPECT_EQ(*folders.Open(place, hash), *first);
  EXPECT_THAT(folders.Open(place, std::string(64, 'b')), HasCode(Code::kInvalidArgument));
  EXPECT_EQ(*folders.Open(place, hash), *first) << "what is open stays";
  EXPECT_THAT(folders.Open("/nowhere", hash), HasCode(Code::kNotFound));

  Folders instead(place);
  EXPECT_THAT(instead.Open("/nowhere", hash), IsOk());
  EXPECT_THAT(instead.Open("/nowhere", std::string(64, 'b')), MessageHas("--clip DIR"));
}

}  // namespace text_encoder_test
}  // namespace etude::clip
