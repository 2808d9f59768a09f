// SPDX-License-Identifier: Apache-2.0
// Tests services/store/episode_file.cc, episode_file_read.cc, hdf_view.cc and hdf.cc
#include "services/store/episode_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string_view>
#include <thread>

#include "services/core/rng.h"
#include "services/episode/codec.h"
#include "services/store/hdf.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"

namespace etude::store::internal {
namespace episode_file_test {

using Bytes = std::vector<std::uint8_t>;

Bytes FileOf(const Episode& episode) {
  auto bytes = EncodeEpisodeFile(episode);
  EXPECT_THAT(bytes, IsOk());
  return bytes ? std::move(*bytes) : Bytes();
}

TEST(EpisodeFile, GivesTheSameEpisodeBack) {
  const CampaignSpec spec = SyntheticSpec(40, 24);
  for (std::uint64_t index = 0; index < 4; ++index) {
    Episode episode = MakeSyntheticEpisode(spec, index, 33);
    episode.objects[1].pixel.values[0] = NAN;
    episode.seed = UINT64_MAX - index;
    const Bytes bytes = FileOf(episode);

    auto file = DecodeEpisodeFile(bytes);

    ASSERT_THAT(file, IsOk());
    EXPECT_EQ(file->frames[0].size(), 7u);
    EXPECT_TRUE(file->episode.cameras[0].streams.empty());
    EXPECT_EQ(file->content_sha256, ContentHash(episode));
    EXPECT_EQ(EpisodeSha256(file->episode, StreamsIn(*file, bytes)), file->content_sha256) << "where its pictures lie";
    EXPECT_EQ(EncodeEpisode(WithStreams(std::move(*file), bytes)), EncodeEpisode(episode));
  }
}

TEST(EpisodeFile, StreamsLieInItAsTheyCame) {
  const Episode episode = Recut(MakeSyntheticEpisode(SyntheticSpec(), 0), {4, 16});
  const Bytes bytes = FileOf(episode);
  const auto file = DecodeEpisodeFile(bytes);
  ASSERT_THAT(file, IsOk());

  ASSERT_EQ(file->frames[0].streams.size(), 6u);
  for (std::size_t k = 0; k < 6; ++k) {
    const auto [offset, size] = file->frames[0].streams[k];
    EXPECT_EQ(Bytes(bytes.begin() + static_cast<std::ptrdiff_t>(offset),
                    bytes.begin() + static_cast<std::ptrdiff_t>(offset + size)),
              episode.cameras[0].streams[k]);
  }
}

TEST(EpisodeFile, HoldsEpisodesWithoutPicturesObjectsStatesOrWithMoreCameras) {
  Episode bare = MakeSyntheticEpisode(SyntheticSpec(), 0, 2);
  bare.objects.clear();
  bare.cameras.clear();
  bare.states = {};
  Episode unrecorded = MakeSyntheticEpisode(SyntheticSpec(), 1, 9);
  unrecorded.cameras[0].streams.clear();
  Episode two = MakeSyntheticEpisode(SyntheticSpec(), 2, 9);
  two.cameras.push_back(two.cameras[0]);
  two.cameras[1].camera.name = "wrist";
  Episode one_of_two = two;
  one_of_two.cameras[1].streams.clear();  // its shape is of nothing
  for (const Episode* episode : {&bare, &unrecorded, &two, &one_of_two}) {
    const Bytes bytes = FileOf(*episode);
    auto file = DecodeEpisodeFile(bytes);
    ASSERT_THAT(file, IsOk());
    EXPECT_EQ(EpisodeSha256(file->episode, StreamsIn(*file, bytes)), file->content_sha256) << "which verify computes";
    EXPECT_EQ(EncodeEpisode(WithStreams(std::move(*file), bytes)), EncodeEpisode(*episode));
  }
}

TEST(EpisodeFile, BytesDependOnTheEpisodeAlone) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(), 5);

  // memory that was never written would show as the filler, so two fillers must give the same file
  ::mallopt(M_PERTURB, 0x35);
  const Bytes first = FileOf(episode);
  ::mallopt(M_PERTURB, 0xCA);
  const Bytes second = FileOf(episode);
  ::mallopt(M_PERTURB, 0);
  Bytes other_thread;
  std::thread([&] { other_thread = FileOf(episode); }).join();

  EXPECT_TRUE(first == second);
  EXPECT_TRUE(first == other_thread);
  EXPECT_FALSE(first == FileOf(MakeSyntheticEpisode(SyntheticSpec(), 6)));
}

TEST(EpisodeFile, RefusesEpisodesThatItCouldNotReadBack) {
  Episode nan = MakeSyntheticEpisode(SyntheticSpec(), 0);
  nan.eef_pos.values[4] = NAN;
  EXPECT_THAT(EncodeEpisodeFile(nan), HasCode(Code::kInvalidArgument));
  Episode garbage = Recut(MakeSyntheticEpisode(SyntheticSpec(), 0), {2, 0});
  garbage.cameras[0].streams[2] = {1, 2, 3};
  EXPECT_THAT(EncodeEpisodeFile(garbage), HasCode(Code::kInvalidArgument));
  EXPECT_THAT(EncodeEpisodeFile(garbage), MessageHas("front stream 2"));
}

TEST(EpisodeFile, FindsEveryTruncationAndEveryFlippedByte) {
  const Bytes bytes = FileOf(MakeSyntheticEpisode(SyntheticSpec(16, 16), 0, 6));
  for (std::size_t size = 0; size < bytes.size(); size += 211)
    ASSERT_THAT(DecodeEpisodeFile(std::span(bytes).first(size)), HasCode(Code::kCorrupt)) << size;
  for (std::size_t cut = 1; cut < 150; ++cut)
    ASSERT_THAT(DecodeEpisodeFile(std::span(bytes).first(bytes.size() - cut)), HasCode(Code::kCorrupt));
  Bytes flipped = bytes;
  for (std::size_t at = 0; at < bytes.size(); at += at + 400 < bytes.size() ? 37 : 1) {
    flipped[at] ^= 1;
    ASSERT_THAT(DecodeEpisodeFile(flipped), HasCode(Code::kCorrupt)) << at;
    flipped[at] ^= 1;
  }
  EXPECT_THAT(DecodeEpisodeFile(flipped), IsOk());
  flipped.push_back('\n');
  EXPECT_THAT(DecodeEpisodeFile(flipped), HasCode(Code::kCorrupt));
}

// A file whose content another version might write, with a good seal.
TEST(EpisodeFile, RefusesSealedFilesOfAnotherLayout) {
  Bytes bytes(3000, 0);
  AppendSeal(bytes);
  EXPECT_THAT(DecodeEpisodeFile(bytes), HasCode(Code::kCorrupt));

  HdfWriter empty;
  empty.Group("/data/demo_0");
  auto image = empty.Finish();
  ASSERT_THAT(image, IsOk());
  AppendSeal(*image);
  EXPECT_THAT(DecodeEpisodeFile(*image), HasCode(Code::kCorrupt));
}

// The same text with another of the same length, resealed, as a forger would.
TEST(EpisodeFile, RefusesResealedFilesWhoseNumbersDoNotFit) {
  const Bytes bytes = FileOf(MakeSyntheticEpisode(SyntheticSpec(16, 16), 0, 6));
  const std::pair<std::string, std::string> edits[] = {
      {"[\"front\"]", "[\"frond\"]"},  // a camera that is not there
      {"[\"front\"]", "[\"../..\"]"}, {"[\"front\"]", "[\"front\" "},
      {"\"pepsi\"", "\"pepsy\""},     {"[\"reach\",\"lift\"]", "[\"reach lift\" ] "},  // a phase without a name
  };
  for (const auto& [from, to] : edits) {
    ASSERT_EQ(from.size(), to.size());
    Bytes edited(bytes.begin(), bytes.end() - static_cast<std::ptrdiff_t>(kSealSize));
    const auto at = std::search(edited.begin(), edited.end(), from.begin(), from.end());
    ASSERT_NE(at, edited.end()) << from;
    std::copy(to.begin(), to.end(), at);
    AppendSeal(edited);
    EXPECT_THAT(DecodeEpisodeFile(edited), HasCode(Code::kCorrupt)) << to;
  }
}

// What no checksum of HDF5's covers: its own library crashes on these, or never ends.
TEST(EpisodeFile, RefusesResealedFilesWhoseHeapsOrTreesLeadAstray) {
  const Episode episode = Recut(MakeSyntheticEpisode(SyntheticSpec(16, 16), 0, 6), {1, 8});  // two frames of two bands
  const auto library = EncodeByLibrary(episode);
  ASSERT_THAT(library, IsOk());
  Bytes ours = FileOf(episode);
  ours.resize(ours.size() - kSealSize);
  struct Edit {
    std::string signature;
    std::size_t at;  // from the signature
    Bytes bytes;
  };
  const auto size = [](std::uint64_t value) {
    Bytes bytes(8);
    std::memcpy(bytes.data(), &value, 8);
    return Edit{"GCOL", 24, bytes};  // of the first object
  };
  const Edit edits[] = {
      size(0x7fffffff),
      size(0xffffffff),
      size(UINT64_MAX - 31),
      size(UINT64_MAX - 15),
      size(UINT64_MAX),
      {"GCOL", 16, Bytes(16, 0)},      // object 0 of no bytes
      {"GCOL", 8, Bytes(8, 0)},        // a collection of no bytes
      {"GCOL", 8, Bytes(8, 0xff)},     // of all
      {"TREE", 5, Bytes{1}},           // a leaf that is none
      {"TREE", 6, Bytes{0xff, 0xff}},  // more entries than there are
      {"TREE", 6, Bytes{0, 0}},        // none
      {"TREE", 72, Bytes(8, 0xff)},    // its first picture lies nowhere
      {"TREE", 24, Bytes(4, 0)},       // and has no bytes
      {"TREE", 32, Bytes{1}},          // the second frame's band twice
      {"TREE", 32, Bytes{2}},          // a frame that is not there
      {"TREE", 40, Bytes{8}},          // the second band twice
      {"TREE", 40, Bytes{4}},          // between two bands
      {"TREE", 40, Bytes{16}},         // a band that is not there
      {"TREE", 48, Bytes{1}},          // a column that is not the first
  };
  for (const Bytes& file : {ours, *library}) {
    Bytes whole = file;
    AppendSeal(whole);
    ASSERT_THAT(DecodeEpisodeFile(whole), IsOk());
    for (const Edit& edit : edits) {
      Bytes edited = file;
      const auto at = std::search(edited.begin(), edited.end(), edit.signature.begin(), edit.signature.end());
      ASSERT_NE(at, edited.end());
      std::copy(edit.bytes.begin(), edit.bytes.end(), at + static_cast<std::ptrdiff_t>(edit.at));
      AppendSeal(edited);
      EXPECT_THAT(DecodeEpisodeFile(edited), HasCode(Code::kCorrupt)) << edit.signature << " + " << edit.at;
    }
    // a node that is its own child
    Bytes cycle = file;
    const std::string_view tree = "TREE";
    const auto at = std::search(cycle.begin(), cycle.end(), tree.begin(), tree.end()) - cycle.begin();
    const auto address = static_cast<std::uint64_t>(at);
    cycle[address + 5] = 1;
    std::memcpy(&cycle[address + 72], &address, sizeof(address));
    AppendSeal(cycle);
    EXPECT_THAT(DecodeEpisodeFile(cycle), HasCode(Code::kCorrupt));
  }
}

// The extents of frames and of their chunks, resealed: checksums of headers are not looked at.
TEST(EpisodeFile, RefusesResealedFilesWhoseFramesHaveExtentsThatDoNotFit) {
  Bytes file = FileOf(Recut(MakeSyntheticEpisode(SyntheticSpec(16, 24), 0, 50), {3, 10}));
  file.resize(file.size() - kSealSize);
  const auto numbers = [](const auto&... values) {
    Bytes bytes;
    const auto add = [&](auto value) {
      const std::size_t at = bytes.size();
      bytes.resize(at + sizeof(value));
      std::memcpy(&bytes[at], &value, sizeof(value));
    };
    (add(values), ...);
    return bytes;
  };
  using U64 = std::uint64_t;
  using U32 = std::uint32_t;
  const Bytes extents = numbers(U64{10}, U64{24}, U64{16}, U64{3}), chunk = numbers(U32{3}, U32{10}, U32{16}, U32{3});
  const std::pair<Bytes, Bytes> edits[] = {
      {extents, numbers(U64{0}, U64{24}, U64{16}, U64{3})},
      {extents, numbers(U64{9}, U64{24}, U64{16}, U64{3})},
      {extents, numbers(U64{1} << 63, U64{24}, U64{16}, U64{3})},
      {extents, numbers(UINT64_MAX, U64{24}, U64{16}, U64{3})},
      {extents, numbers(UINT64_MAX - 1, U64{24}, U64{16}, U64{3})},
      {extents, numbers(U64{10}, UINT64_MAX, U64{16}, U64{3})},
      {extents, numbers(U64{10}, U64{24}, U64{16}, U64{4})},
      {chunk, numbers(U32{0}, U32{10}, U32{16}, U32{3})},
      {chunk, numbers(U32{2}, U32{10}, U32{16}, U32{3})},
      {chunk, numbers(U32{11}, U32{10}, U32{16}, U32{3})},
      {chunk, numbers(UINT32_MAX, U32{10}, U32{16}, U32{3})},
      {chunk, numbers(U32{3}, U32{0}, U32{16}, U32{3})},
      {chunk, numbers(U32{3}, U32{25}, U32{16}, U32{3})},
      {chunk, numbers(U32{3}, UINT32_MAX, U32{16}, U32{3})},
      {chunk, numbers(U32{3}, U32{10}, U32{8}, U32{3})},
      {chunk, numbers(U32{3}, U32{10}, U32{16}, U32{1})},
  };
  const auto edit = [&](Bytes& bytes, const Bytes& from, const Bytes& to) {
    const auto at = std::search(bytes.begin(), bytes.end(), from.begin(), from.end());
    ASSERT_NE(at, bytes.end());
    std::copy(to.begin(), to.end(), at);
  };
  for (const auto& [from, to] : edits) {
    Bytes edited = file;
    edit(edited, from, to);
    AppendSeal(edited);
    EXPECT_THAT(DecodeEpisodeFile(edited), HasCode(Code::kCorrupt)) << testing::PrintToString(to);
  }
  for (const U32 width : {U32{0}, U32{1} << 31, UINT32_MAX}) {  // the same in both
    Bytes edited = file;
    edit(edited, extents, numbers(U64{10}, U64{24}, U64{width}, U64{3}));
    edit(edited, chunk, numbers(U32{3}, U32{10}, width, U32{3}));
    AppendSeal(edited);
    EXPECT_THAT(DecodeEpisodeFile(edited), HasCode(Code::kCorrupt)) << width;
  }
  AppendSeal(file);
  EXPECT_THAT(DecodeEpisodeFile(file), IsOk());
}

TEST(EpisodeFile, ReadsWhatTheLibraryMade) {
  for (const int steps : {2, 50, 333}) {
    const Episode episode = Recut(MakeSyntheticEpisode(SyntheticSpec(40, 24), 3, steps), {1 + steps / 16, 7});
    auto bytes = EncodeByLibrary(episode);
    ASSERT_THAT(bytes, IsOk());
    AppendSeal(*bytes);
    auto file = DecodeEpisodeFile(*bytes);
    ASSERT_THAT(file, IsOk());
    EXPECT_EQ(EncodeEpisode(WithStreams(std::move(*file), *bytes)), EncodeEpisode(episode));
  }
}

}  // namespace episode_file_test
}  // namespace etude::store::internal
