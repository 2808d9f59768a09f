// SPDX-License-Identifier: Apache-2.0
// Tests services/episode/codec.cc
#include "services/episode/codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cmath>
#include <cstring>

#include "services/core/hash.h"
#include "services/core/rng.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"

namespace etude {
namespace codec_test {

using Bytes = std::vector<std::uint8_t>;

Bytes Encoded() { return EncodeEpisode(MakeSyntheticEpisode(SyntheticSpec(16, 16), 3, 12)); }

// the header's text with `from` replaced by `to`, sizes corrected
Bytes EditHeader(const Bytes& bytes, const std::string& from, const std::string& to) {
  std::uint32_t size = 0;
  std::memcpy(&size, bytes.data() + 8, 4);
  std::string header(bytes.begin() + 12, bytes.begin() + 12 + size);
  const auto at = header.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  if (at == std::string::npos) return bytes;
  header.replace(at, from.size(), to);
  Bytes edited(bytes.begin(), bytes.begin() + 12);
  size_t new_size = header.size();
  const auto size32 = static_cast<std::uint32_t>(new_size);
  std::memcpy(edited.data() + 8, &size32, 4);
  edited.insert(edited.end(), header.begin(), header.end());
  edited.insert(edited.end(), bytes.begin() + 12 + size, bytes.end());
  return edited;
}

TEST(Codec, TheHashIsThatOfTheBytes) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(16, 16), 3, 12);
  const std::string expected = Sha256Hex(EncodeEpisode(episode));
  EXPECT_EQ(EpisodeSha256(episode, StreamsOf(episode)), expected);
  const Episode whole = episode;
  for (auto& camera : episode.cameras) camera.streams.clear();
  EXPECT_EQ(EpisodeSha256(episode, StreamsOf(whole)), expected) << "its pictures lie elsewhere";
}

TEST(Codec, GivesTheSameEpisodeBack) {
  const CampaignSpec spec = SyntheticSpec();
  Episode episode = MakeSyntheticEpisode(spec, 7);
  episode.seed = UINT64_MAX;
  episode.attempt = UINT32_MAX;
  episode.reference = "caf\xc3\xa9";
  episode.objects[0].pixel.values[0] = NAN;

  const auto decoded = DecodeEpisode(EncodeEpisode(episode));

  ASSERT_THAT(decoded, IsOk());
  EXPECT_EQ(decoded->seed, UINT64_MAX);
  EXPECT_EQ(decoded->attempt, UINT32_MAX);
  EXPECT_EQ(decoded->instruction, episode.instruction);
  EXPECT_EQ(decoded->reference, episode.reference);
  EXPECT_EQ(decoded->details, episode.details);
  EXPECT_EQ(decoded->joint_pos.values, episode.joint_pos.values);
  EXPECT_EQ(decoded->phase, episode.phase);
  EXPECT_EQ(decoded->stage_names, episode.stage_names);
  EXPECT_EQ(decoded->objects[3].name, episode.objects[3].name);
  EXPECT_EQ(decoded->objects[3].pose.values, episode.objects[3].pose.values);
  EXPECT_TRUE(std::isnan(decoded->objects[0].pixel.values[0]));
  EXPECT_EQ(decoded->cameras[0].chunk, episode.cameras[0].chunk);
  EXPECT_EQ(decoded->cameras[0].streams, episode.cameras[0].streams);
  EXPECT_EQ(decoded->cameras[0].camera.fovy, episode.cameras[0].camera.fovy);
  EXPECT_EQ(decoded->cameras[0].camera.X_WC.q.coeffs(), episode.cameras[0].camera.X_WC.q.coeffs());
  EXPECT_EQ(EncodeEpisode(*decoded), EncodeEpisode(episode));
}

// Until content version 10 a frame was a stream: what was hashed then has that hash for ever.
TEST(Codec, EpisodesOfWholeFramesAreWrittenAsTheyWere) {
  const Episode episode = Recut(MakeSyntheticEpisode(SyntheticSpec(16, 16), 3, 12), {1, 0});
  const Bytes bytes = EncodeEpisode(episode);
  const std::string text(bytes.begin() + 12, bytes.begin() + 2000);
  EXPECT_THAT(text, testing::StartsWith("{\"format\":2,"));
  EXPECT_THAT(text, testing::HasSubstr("\"frames\":["));
  EXPECT_THAT(text, testing::Not(testing::HasSubstr("chunk")));
  const auto view = ViewEpisode(bytes);
  ASSERT_THAT(view, IsOk());
  EXPECT_EQ(view->streams.at(0).size(), 3u);
  EXPECT_EQ(EncodeEpisode(*DecodeEpisode(bytes)), bytes);
  Episode all_rows = episode;
  ASSERT_EQ(all_rows.cameras[0].chunk.rows, 16);
  all_rows.cameras[0].chunk.rows = 0;
  EXPECT_EQ(EncodeEpisode(all_rows), bytes);
}

TEST(Codec, ReplacesTextThatIsNotUtf8InsteadOfThrowing) {
  Episode episode = MakeSyntheticEpisode(SyntheticSpec(16, 16), 0, 5);
  episode.outcome = "bad \xff byte";

  EXPECT_THAT(DecodeEpisode(EncodeEpisode(episode)), IsOk());
}

TEST(Codec, RefusesEveryTruncationAndEveryExtraByte) {
  const Bytes bytes = Encoded();
  for (std::size_t size = 0; size < bytes.size(); size += size < 3000 ? 1 : 97) {
    ASSERT_THAT(DecodeEpisode(std::span(bytes).first(size)), HasCode(Code::kCorrupt)) << size;
    if (size % 16 != 0) continue;
    ASSERT_THAT(ViewEpisode(std::span(bytes).first(size)), HasCode(Code::kCorrupt)) << size;
  }
  Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_THAT(DecodeEpisode(longer), HasCode(Code::kCorrupt));
  EXPECT_THAT(ViewEpisode(longer), HasCode(Code::kCorrupt));
}

// what a collector reads of whoever sends
TEST(Codec, AViewIsOfBytesThatThisProgramWritesAndLeavesThePicturesThere) {
  const Bytes bytes = Encoded();
  const auto view = ViewEpisode(bytes);
  ASSERT_THAT(view, IsOk());
  EXPECT_EQ(EpisodeSha256(view->episode, view->streams), Sha256Hex(bytes));
  EXPECT_TRUE(view->episode.cameras[0].streams.empty());
  const auto stream = view->streams.at(0).at(0);
  EXPECT_TRUE(stream.data() > bytes.data() && stream.data() + stream.size() <= bytes.data() + bytes.size());
  const Bytes spaced = EditHeader(bytes, "\"index\":3", "\"index\": 3");
  EXPECT_THAT(DecodeEpisode(spaced), IsOk()) << "the same episode";
  EXPECT_THAT(ViewEpisode(spaced), MessageHas("not written as this program writes it"));
}

TEST(Codec, RefusesHeadersThatDoNotFitTheBlobs) {
  const Bytes bytes = Encoded();
  const std::pair<const char*, const char*> edits[] = {
      {"\"format\":3", "\"format\":1"},
      {"\"format\":3", "\"format\":2"},
      {"\"format\":3", "\"format\":4"},
      {"\"shape\":[12,6]", "\"shape\":[12,7]"},
      {"\"shape\":[12,6]", "\"shape\":[4611686018427387904,24]"},  // 4 * product wraps to 0
      {"\"shape\":[12,6]", "\"shape\":[12]"},
      {"\"shape\":[12,6]", "\"shape\":[-12,-6]"},
      {"\"shape\":[12,6]", "\"shape\":[12,[6]]"},
      {"\"size\":288", "\"size\":18446744073709551615"},
      {"\"offset\":0", "\"offset\":4"},
      {"\"dtype\":\"f32\"", "\"dtype\":\"u8\""},
      {"\"name\":\"joint_vel\"", "\"name\":\"joint_pos\""},
      {"\"width\":16", "\"width\":1000000000"},
      {"\"width\":16", "\"width\":16.5"},
      {"\"streams\":[", "\"streams\":[18446744073709551615,"},
      {"\"streams\":[", "\"streams\":[-1,"},
      {"\"chunk\":[3,16]", "\"chunk\":[0,16]"},
      {"\"chunk\":[3,16]", "\"chunk\":[3,17]"},
      {"\"chunk\":[3,16]", "\"chunk\":[2,16]"},
      {"\"chunk\":[3,16]", "\"chunk\":[4,16]"},
      {"\"chunk\":[3,16]", "\"chunk\":[2.5,16]"},
      {"\"chunk\":[3,16]", "\"chunk\":[3,16,1]"},
      {"\"chunk\":[3,16]", "\"chunk\":[1e300,16]"},
      {"\"image_stride\":5", "\"image_stride\":0"},
      {"\"image_stride\":5", "\"image_stride\":3"},
      {"\"success\":true", "\"success\":1"},
      {"\"index\":3", "\"index\":-3"},
      {"\"index\":3", "\"index\":3,\"index\":4"},
      {"\"attempt\":0", "\"attempt\":4294967296"},
      {"\"fovy\":", "\"fovy\":1e308,\"x\":"},
      {"\"objects\":[\"cube\"", "\"objects\":[7"},
      {"\"campaign\":", "\"kampagne\":"},
  };
  for (const auto& [from, to] : edits) {
    EXPECT_THAT(DecodeEpisode(EditHeader(bytes, from, to)), HasCode(Code::kCorrupt)) << to;
    EXPECT_THAT(ViewEpisode(EditHeader(bytes, from, to)), HasCode(Code::kCorrupt)) << to;
  }
}

TEST(Codec, AcceptsTheHarnessOfItsOwnTest) {
  const Bytes bytes = Encoded();

  EXPECT_THAT(DecodeEpisode(EditHeader(bytes, "\"index\":3", "\"index\":44")), IsOk());
}

// One to four random edits: flips, cuts, doubled pieces, numbers in the header made large.
Bytes Mutate(Bytes bytes, Rng& rng) {
  for (std::uint64_t n = rng.Below(4) + 1; n > 0 && !bytes.empty(); --n) {
    const std::size_t reach = rng.Bernoulli(0.7) ? std::min<std::size_t>(bytes.size(), 4000) : bytes.size();
    const std::size_t at = rng.Below(reach);
    switch (rng.Below(5)) {
      case 0:
        bytes[at] ^= static_cast<std::uint8_t>(1u << rng.Below(8));
        break;
      case 1:
        bytes[at] = static_cast<std::uint8_t>(rng.Next());
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3: {
        const Bytes piece(bytes.begin() + at, bytes.begin() + std::min(bytes.size(), at + rng.Below(64)));
        bytes.insert(bytes.begin() + at, piece.begin(), piece.end());
        break;
      }
      default:
        if (bytes[at] >= '0' && bytes[at] <= '9') bytes.insert(bytes.begin() + at, 12, '9');
    }
  }
  return bytes;
}

TEST(Codec, NeverCrashesOrAllocatesWildlyOnMutatedBytes) {
  const Bytes bytes = Encoded();
  Rng rng(42);
  struct rusage before {
  }, after{};
  ::getrusage(RUSAGE_SELF, &before);
  int accepted = 0;
  for (int i = 0; i < 20'000; ++i) {
    const auto decoded = DecodeEpisode(Mutate(bytes, rng));
    if (decoded) {
      ++accepted;
      ASSERT_THAT(ValidateEpisode(*decoded), IsOk());
    } else {
      ASSERT_EQ(decoded.error().code, Code::kCorrupt);
    }
  }
  ::getrusage(RUSAGE_SELF, &after);

  EXPECT_GT(accepted, 100);  // flips in floats and frames are not the codec's to find
  EXPECT_LT(accepted, 15'000);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 64 * 1024);  // KiB
}

}  // namespace codec_test
}  // namespace etude
