// SPDX-License-Identifier: Apache-2.0
// Tests worker/host/frame.cc: what is sent arrives however it is cut, and garbage allocates nothing.
#include "worker/host/frame.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <thread>

#include "services/core/rng.h"
#include "services/episode/bounded_json.h"

namespace etude::host {
namespace frame_test {

using namespace std::chrono_literals;

std::vector<std::uint8_t> Encoded(FrameKind kind, const std::string& head, const std::vector<std::uint8_t>& bytes) {
  const auto header = FrameHeader(kind, static_cast<std::uint32_t>(head.size()), bytes.size());
  std::vector<std::uint8_t> all(header.size() + head.size() + bytes.size());
  auto end = std::copy(header.begin(), header.end(), all.begin());
  end = std::copy(head.begin(), head.end(), end);
  std::copy(bytes.begin(), bytes.end(), end);
  return all;
}

TEST(FrameDecoder, FindsFramesHoweverTheyAreCut) {
  std::vector<std::uint8_t> stream = Encoded(FrameKind::kWork, R"({"index": 7})", {});
  const auto second = Encoded(FrameKind::kResult, R"({"outcome": "success"})", {1, 2, 3});
  stream.insert(stream.end(), second.begin(), second.end());
  for (std::size_t size = 1; size <= stream.size(); ++size) {
    FrameDecoder decoder;
    std::vector<Frame> frames;
    for (std::size_t begin = 0; begin < stream.size(); begin += size) {
      ASSERT_TRUE(decoder.Add(std::span(stream).subspan(begin, std::min(size, stream.size() - begin))));
      while (true) {
        auto frame = decoder.Next();
        ASSERT_TRUE(frame) << frame.error().message;
        if (!*frame) break;
        frames.push_back(std::move(**frame));
      }
    }
    ASSERT_EQ(frames.size(), 2u) << "in pieces of " << size;
    EXPECT_EQ(frames[0].kind, FrameKind::kWork);
    EXPECT_EQ(frames[0].head["index"], 7);
    EXPECT_EQ(frames[1].bytes, (std::vector<std::uint8_t>{1, 2, 3}));
  }
}

TEST(FrameDecoder, RefusesImpossibleLengthsBeforeTheirBytesCome) {
  for (const auto& header :
       {FrameHeader(FrameKind::kResult, kLongestHead + 1, 0), FrameHeader(FrameKind::kResult, 2, kMostBytes + 1),
        FrameHeader(FrameKind::kResult, 0xffffffff, ~0ull), FrameHeader(static_cast<FrameKind>(0), 2, 0),
        FrameHeader(static_cast<FrameKind>(9), 2, 0)}) {
    FrameDecoder decoder;
    const Status added = decoder.Add(header);
    ASSERT_FALSE(added);
    EXPECT_EQ(added.error().code, Code::kCorrupt);
    EXPECT_FALSE(decoder.Next()) << "it stays in error";
  }
}

TEST(FrameDecoder, TakesWhatAPolicyMaySay) {
  // as deep as a policy's modules may be, inside of an answer
  const std::string modules = std::string(kMaxJsonDepth, '[') + std::string(kMaxJsonDepth, ']');
  const std::string text(5u << 20, 'x');
  FrameDecoder decoder;
  ASSERT_TRUE(
      decoder.Add(Encoded(FrameKind::kAnswer, R"({"modules": )" + modules + R"(, "text": ")" + text + "\"}", {})));
  const auto frame = decoder.Next();
  ASSERT_TRUE(frame) << frame.error().message;
  ASSERT_TRUE(*frame);
  EXPECT_EQ((*frame)->head["text"].get<std::string>().size(), text.size());
}

TEST(FrameDecoder, RefusesHeadsThatAreNoObjects) {
  for (const std::string head : {"", "7", "[1]", "{", R"({"a": 1, "a": 2})"}) {
    FrameDecoder decoder;
    ASSERT_TRUE(decoder.Add(Encoded(FrameKind::kReady, head, {})));
    EXPECT_FALSE(decoder.Next()) << head;
  }
}

TEST(FrameDecoder, SurvivesGarbage) {
  Rng rng(3);
  for (int round = 0; round < 300; ++round) {
    std::vector<std::uint8_t> bytes(rng.Below(200));
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(rng.Below(256));
    // half of the rounds begin like a frame
    const auto header = FrameHeader(FrameKind::kResult, static_cast<std::uint32_t>(rng.Below(64)), rng.Below(64));
    if (round % 2) std::copy_n(header.begin(), std::min(bytes.size(), header.size()), bytes.begin());
    FrameDecoder decoder;
    if (decoder.Add(bytes)) (void)decoder.Next();
  }
}

TEST(Channel, CarriesMoreThanTheSocketHolds) {
  const auto ends = MakeSocketPair();
  ASSERT_TRUE(ends);
  Channel up((*ends)[0]), down((*ends)[1]);
  std::vector<std::uint8_t> bytes(3 << 20);
  for (std::size_t k = 0; k < bytes.size(); ++k) bytes[k] = static_cast<std::uint8_t>(k * 7);
  std::thread sender([&] { EXPECT_TRUE(up.Send(FrameKind::kResult, {{"outcome", ""}}, bytes)); });
  std::optional<Frame> frame;
  while (!frame) {
    auto received = down.Receive(1000ms);
    ASSERT_TRUE(received) << received.error().message;
    frame = std::move(*received);
  }
  sender.join();
  EXPECT_EQ(frame->bytes, bytes);
}

TEST(Channel, SaysWhenTheOtherEndHasGoneOrDoesNotRead) {
  const auto ends = MakeSocketPair();
  ASSERT_TRUE(ends);
  Channel up((*ends)[0]);
  {
    Channel down((*ends)[1]);
    up.LimitSend(20ms);
    const Status blocked = up.Send(FrameKind::kResult, OrderedJson::object(), std::vector<std::uint8_t>(8 << 20));
    ASSERT_FALSE(blocked);
    EXPECT_EQ(blocked.error().code, Code::kTimeout);
  }
  const auto received = up.Receive(100ms);
  ASSERT_FALSE(received);
  EXPECT_EQ(received.error().code, Code::kUnavailable);
}

}  // namespace frame_test
}  // namespace etude::host
