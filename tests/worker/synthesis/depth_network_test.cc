// SPDX-License-Identifier: Apache-2.0
// Tests worker/synthesis/depth_network.cc with a network made here: depth is how much brighter a pixel is than the
// mean.
#include "worker/synthesis/depth_network.h"

#include <gmock/gmock.h>

#include <cmath>

#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"
#include "worker/synthesis/heightfield.h"
#include "worker/synthesis/picture_file.h"

namespace etude::synthesis {
namespace depth_network_test {

// just enough of protobuf's wire format for an ONNX file
std::string Varint(std::uint64_t value) {
  std::string bytes;
  for (; value >= 128; value >>= 7) bytes += static_cast<char>(value % 128 + 128);
  return bytes + static_cast<char>(value);
}
std::string Number(int field, std::uint64_t value) { return Varint(8 * field) + Varint(value); }
std::string Message(int field, const std::string& content) {
  return Varint(8 * field + 2) + Varint(content.size()) + content;
}

/// ValueInfo of a float tensor.
std::string Value(const std::string& name, const std::vector<int>& shape) {
  std::string dims;
  for (const int size : shape) dims += Message(1, Number(1, size));
  return Message(1, name) + Message(2, Message(1, Number(1, 1) + Message(2, dims)));
}

/// A 1 x 1 convolution that adds the three channels up, each times `weight`.
std::string SumOfChannels(int size, float weight = 1) {
  const float ones[3] = {weight, weight, weight};
  std::string weights = Number(1, 1) + Number(1, 3) + Number(1, 1) + Number(1, 1) + Number(2, 1) + Message(8, "w");
  weights += Message(9, std::string(reinterpret_cast<const char*>(ones), sizeof ones));
  const std::string kernel = Message(1, "kernel_shape") + Number(8, 1) + Number(8, 1) + Number(20, 7);
  const std::string node =
      Message(1, "x") + Message(1, "w") + Message(2, "y") + Message(4, "Conv") + Message(5, kernel);
  const std::string graph = Message(1, node) + Message(2, "sum") + Message(5, weights) +
                            Message(11, Value("x", {1, 3, size, size})) + Message(12, Value("y", {1, 1, size, size}));
  return Number(1, 7) + Message(7, graph) + Message(8, Number(2, 11));
}

/// A ball on white, brightest in its middle.
Texture BrightBall(int size) {
  Texture texture{size, size, {}};
  for (int i = 0; i < size * size; ++i) {
    const double r = std::hypot(i % size + 0.5 - size / 2.0, i / size + 0.5 - size / 2.0) / (0.4 * size);
    const double height = r < 1 ? std::sqrt(1 - r * r) : 0;
    const auto value = static_cast<std::uint8_t>(r < 1 ? 40 + 160 * height : 255);
    texture.rgb.insert(texture.rgb.end(), 3, value);
  }
  return texture;
}

TEST(DepthNetwork, GivesAPictureItsDepth) {
  const TemporaryFolder folder;
  const Path onnx = folder.path() / "sum.onnx", rgb = folder.path() / "ball.png";
  ASSERT_THAT(WriteFileAtomically(onnx, SumOfChannels(64)), IsOk());
  ASSERT_THAT(WriteFileAtomically(rgb, EncodePng(BrightBall(96)).value()), IsOk());
  auto network = DepthNetwork::Open(onnx, {.width = 64, .height = 64, .relief = 0.4});
  ASSERT_THAT(network, IsOk());

  const auto picture = network->Read(rgb);
  ASSERT_THAT(picture, IsOk());
  EXPECT_EQ(picture->width, 96);
  EXPECT_EQ(picture->relief, 0.4);
  const auto at = [&](int x, int y) { return static_cast<std::size_t>(y) * 96 + x; };
  EXPECT_EQ(picture->mask[at(2, 2)], 0);
  EXPECT_EQ(picture->mask[at(48, 48)], 1);
  EXPECT_GT(picture->depth[at(48, 48)], 0.95);
  EXPECT_LT(picture->depth[at(48, 12)], 0.5);
  EXPECT_GT(picture->depth[at(48, 30)], picture->depth[at(48, 15)]);
  EXPECT_THAT(RaiseHeightfield(*picture), IsOk());
}

TEST(DepthNetwork, NamesWhatIsWrong) {
  const TemporaryFolder folder;
  const Path onnx = folder.path() / "sum.onnx", rgb = folder.path() / "white.png";
  EXPECT_THAT(DepthNetwork::Open(folder.path() / "none.onnx"), HasCode(Code::kNotFound));
  EXPECT_THAT(DepthNetwork::Open(folder.path() / "none.onnx"), MessageHas("MiDaS"));
  ASSERT_THAT(WriteFileAtomically(onnx, std::string_view("no network")), IsOk());
  EXPECT_THAT(DepthNetwork::Open(onnx), HasCode(Code::kCorrupt));

  ASSERT_THAT(WriteFileAtomically(onnx, SumOfChannels(64)), IsOk());
  auto network = DepthNetwork::Open(onnx, {.width = 64, .height = 64});
  ASSERT_THAT(network, IsOk());
  EXPECT_THAT(network->Read(folder.path() / "none.png"), HasCode(Code::kNotFound));
  ASSERT_THAT(WriteFileAtomically(rgb, EncodePng({64, 64, std::vector<std::uint8_t>(3 * 64 * 64, 255)}).value()),
              IsOk());
  EXPECT_THAT(network->Read(rgb), HasCode(Code::kInvalidArgument));

  // half-precision networks run over
  ASSERT_THAT(WriteFileAtomically(onnx, SumOfChannels(64, std::nanf(""))), IsOk());
  auto broken = DepthNetwork::Open(onnx, {.width = 64, .height = 64});
  ASSERT_THAT(broken, IsOk());
  ASSERT_THAT(WriteFileAtomically(rgb, EncodePng(BrightBall(96)).value()), IsOk());
  EXPECT_THAT(broken->Read(rgb), MessageHas("no finite numbers"));
}

}  // namespace depth_network_test
}  // namespace etude::synthesis
