// SPDX-License-Identifier: Apache-2.0
// Tests services/store/safetensors.cc
#include "services/store/safetensors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstring>

#include "services/core/config.h"
#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::store {
namespace safetensors_test {

using Bytes = std::vector<std::uint8_t>;

Safetensors Example() {
  Safetensors content;
  content.metadata = {{"format", "pt"}, {"step", "12"}};
  content.tensors["b.weight"] = {DType::kF32, {2, 3}, Bytes(24, 7)};
  content.tensors["a.bias"] = {DType::kBF16, {5}, Bytes(10, 9)};
  content.tensors["scalar"] = {DType::kI64, {}, Bytes(8, 1)};
  content.tensors["none"] = {DType::kF32, {0, 4}, {}};
  content.tensors["mask"] = {DType::kBool, {3}, {1, 0, 1}};
  return content;
}

Bytes File(const std::string& header, std::size_t data_size) {
  Bytes bytes(8 + header.size() + data_size);
  const std::uint64_t size = header.size();
  std::memcpy(bytes.data(), &size, 8);
  std::copy(header.begin(), header.end(), bytes.begin() + 8);
  return bytes;
}

TEST(Safetensors, GivesTheSameContentBack) {
  const auto decoded = DecodeSafetensors(EncodeSafetensors(Example()));

  ASSERT_THAT(decoded, IsOk());
  EXPECT_EQ(decoded->metadata, Example().metadata);
  ASSERT_EQ(decoded->tensors.size(), 5u);
  for (const auto& [name, tensor] : Example().tensors) {
    EXPECT_EQ(decoded->tensors.at(name).dtype, tensor.dtype) << name;
    EXPECT_EQ(decoded->tensors.at(name).shape, tensor.shape) << name;
    EXPECT_EQ(decoded->tensors.at(name).data, tensor.data) << name;
  }
}

TEST(Safetensors, LeavesOutWhatIsNotWanted) {
  const Bytes bytes = EncodeSafetensors(Example());
  const auto some =
      DecodeSafetensors(bytes, [](std::string_view name) { return name.ends_with("bias") || name == "mask"; });
  ASSERT_THAT(some, IsOk());
  ASSERT_EQ(some->tensors.size(), 2u);
  EXPECT_EQ(some->tensors.at("a.bias").data, Example().tensors.at("a.bias").data);
  EXPECT_EQ(some->tensors.at("mask").data, Example().tensors.at("mask").data);
  EXPECT_EQ(some->metadata, Example().metadata);
  // and yet all of the file is checked
  const Bytes cut(bytes.begin(), bytes.end() - 1);
  EXPECT_THAT(DecodeSafetensors(cut, [](std::string_view) { return false; }), HasCode(Code::kCorrupt));
}

TEST(Safetensors, WritesTheDocumentedBytes) {
  Safetensors content;
  content.tensors["x"] = {DType::kU8, {2}, {5, 6}};
  const std::string header = R"({"x":{"dtype":"U8","shape":[2],"data_offsets":[0,2]}})";
  Bytes expected = File(header + std::string((8 - header.size() % 8) % 8, ' '), 0);
  expected.insert(expected.end(), {5, 6});

  EXPECT_EQ(EncodeSafetensors(content), expected);
}

TEST(Safetensors, AlignsEveryTensorToItsType) {
  const Bytes bytes = EncodeSafetensors(Example());
  std::uint64_t header_size = 0;
  std::memcpy(&header_size, bytes.data(), 8);
  EXPECT_EQ(header_size % 8, 0u);
  const auto json = OrderedJson::parse(bytes.begin() + 8, bytes.begin() + 8 + static_cast<int>(header_size));
  for (const auto& [name, tensor] : Example().tensors)
    EXPECT_EQ(json[name]["data_offsets"][0].get<std::uint64_t>() % SizeOf(tensor.dtype), 0u) << name;
}

TEST(Safetensors, SurvivesAFile) {
  const TemporaryFolder folder;
  const Path path = folder / "sub/model.safetensors";
  ASSERT_THAT(WriteSafetensors(path, Example()), IsOk());

  const auto read = ReadSafetensors(path);

  ASSERT_THAT(read, IsOk());
  EXPECT_EQ(EncodeSafetensors(*read), EncodeSafetensors(Example()));
  EXPECT_THAT(ReadSafetensors(folder / "none"), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteFileAtomically(path, std::string_view("garbage, not tensors")), IsOk());
  EXPECT_THAT(ReadSafetensors(path), HasCode(Code::kCorrupt));
  EXPECT_THAT(ReadSafetensors(path), MessageHas("model.safetensors"));
}

TEST(Safetensors, RefusesHeadersThatLie) {
  const auto entry = [](const std::string& dtype, const std::string& shape, const std::string& offsets) {
    return R"({"dtype":")" + dtype + R"(","shape":)" + shape + R"(,"data_offsets":)" + offsets + "}";
  };
  const std::string good = entry("U8", "[4]", "[0,4]");
  ASSERT_THAT(DecodeSafetensors(File("{\"x\":" + good + "}", 4)), IsOk());
  const std::pair<std::string, std::size_t> bad[] = {
      {"{\"x\":" + good + "}", 5},                                            // bytes after the last
      {"{\"x\":" + good + "}", 3},                                            // out of range
      {"{\"x\":" + good + ",\"y\":" + good + "}", 4},                         // overlap
      {"{\"x\":" + good + ",\"y\":" + entry("U8", "[2]", "[6,8]") + "}", 8},  // hole
      {"{\"x\":" + good + ",\"x\":" + entry("U8", "[4]", "[4,8]") + "}", 8},  // duplicate
      {"{\"x\":" + entry("F32", "[4]", "[0,4]") + "}", 4},                    // size and dtype
      {"{\"x\":" + entry("U9", "[4]", "[0,4]") + "}", 4},
      {"{\"x\":" + entry("U8", "[-4]", "[0,4]") + "}", 4},
      {"{\"x\":" + entry("U8", "[4.0]", "[0,4]") + "}", 4},
      {"{\"x\":" + entry("U8", "[4]", "[4,0]") + "}", 4},
      {"{\"x\":" + entry("U8", "[4]", "[0]") + "}", 4},
      {"{\"x\":" + entry("U8", "[4]", "[0,4,4]") + "}", 4},
      {"{\"x\":" + entry("F64", "[2305843009213693952,1]", "[0,0]") + "}", 0},  // product wraps to 0
      {"{\"x\":" + entry("U8", "[4294967296,4294967296]", "[0,0]") + "}", 0},
      {"{\"x\":" + entry("U8", "[18446744073709551615]", "[0,4]") + "}", 4},
      {"{\"x\":5}", 0},
      {"{\"__metadata__\":{\"a\":1}}", 0},
      {"{\"__metadata__\":[]}", 0},
      {"[]", 0},
      {" {}", 0},
      {"{\"x\":", 0},
      {"", 0},
  };
  for (const auto& [header, size] : bad)
    EXPECT_THAT(DecodeSafetensors(File(header, size)), HasCode(Code::kCorrupt)) << header;
}

TEST(Safetensors, RefusesHeaderSizesWithoutAllocating) {
  Bytes bytes = EncodeSafetensors(Example());
  for (const std::uint64_t size : {std::uint64_t{UINT64_MAX}, std::uint64_t{1} << 40, std::uint64_t{100'000'001},
                                   std::uint64_t{bytes.size() - 7}}) {
    std::memcpy(bytes.data(), &size, 8);
    EXPECT_THAT(DecodeSafetensors(bytes), HasCode(Code::kCorrupt)) << size;
  }
  EXPECT_THAT(DecodeSafetensors(std::span(bytes).first(7)), HasCode(Code::kCorrupt));
  EXPECT_THAT(DecodeSafetensors({}), HasCode(Code::kCorrupt));
}

TEST(Safetensors, NeverCrashesOrAllocatesWildlyOnMutatedBytes) {
  const Bytes bytes = EncodeSafetensors(Example());
  Rng rng(7);
  struct rusage before {
  }, after{};
  ::getrusage(RUSAGE_SELF, &before);
  int refused = 0;
  for (int i = 0; i < 30'000; ++i) {
    Bytes mutated = bytes;
    for (std::uint64_t n = rng.Below(3) + 1; n > 0 && !mutated.empty(); --n) {
      const std::size_t at = rng.Below(mutated.size());
      switch (rng.Below(4)) {
        case 0:
          mutated[at] = static_cast<std::uint8_t>(rng.Next());
          break;
        case 1:
          mutated.resize(at);
          break;
        case 2:
          mutated.insert(mutated.begin() + static_cast<std::ptrdiff_t>(at), "0123456789[]{}\":,"[rng.Below(17)]);
          break;
        default:
          mutated[at] ^= static_cast<std::uint8_t>(1u << rng.Below(8));
      }
    }
    const auto decoded = DecodeSafetensors(mutated);
    if (!decoded) {
      ++refused;
      ASSERT_EQ(decoded.error().code, Code::kCorrupt);
    } else {
      ASSERT_THAT(DecodeSafetensors(EncodeSafetensors(*decoded)), IsOk());
    }
  }
  ::getrusage(RUSAGE_SELF, &after);

  EXPECT_GT(refused, 15'000);
  EXPECT_LT(refused, 30'000);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 64 * 1024);  // KiB
}

}  // namespace safetensors_test
}  // namespace etude::store
