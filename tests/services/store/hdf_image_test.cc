// SPDX-License-Identifier: Apache-2.0
// Tests services/store/hdf_image.cc: HDF5's own library must find in it what it finds in a file that it made itself.
#include "services/store/hdf_image.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>

#include <map>
#include <span>
#include <utility>

#include "services/store/episode_file.h"
#include "services/store/hdf.h"
#include "tests/support/matchers.h"
#include "tests/support/synthetic_episode.h"

namespace etude::store::internal {
namespace hdf_image_test {

using Bytes = std::vector<std::uint8_t>;

std::string Dump(const void* data, std::size_t size) { return {static_cast<const char*>(data), size}; }

std::string TypeAndExtents(hid_t type, hid_t space) {
  std::size_t size = 0;
  H5Tencode(type, nullptr, &size);
  std::string text(size, '\0');
  EXPECT_GE(H5Tencode(type, text.data(), &size), 0);
  hsize_t extents[8] = {}, most[8] = {};
  const int rank = H5Sget_simple_extent_dims(space, extents, most);
  EXPECT_GE(rank, 0);
  return text + Dump(extents, sizeof(extents)) + Dump(most, sizeof(most)) + std::to_string(rank) +
         std::to_string(H5Sget_simple_extent_type(space));
}

std::string AttributeText(hid_t object, const char* name) {
  const Hid attribute(H5Aopen(object, name, H5P_DEFAULT));
  const Hid type(H5Aget_type(attribute.get())), space(H5Aget_space(attribute.get()));
  std::string text = TypeAndExtents(type.get(), space.get());
  if (H5Tis_variable_str(type.get()) > 0) {
    char* value = nullptr;
    EXPECT_GE(H5Aread(attribute.get(), type.get(), &value), 0) << name;
    text += value == nullptr ? "(nothing)" : std::string("'") + value + "'";
    H5free_memory(value);
    return text;
  }
  std::string value(H5Tget_size(type.get()) * static_cast<std::size_t>(H5Sget_simple_extent_npoints(space.get())), 'x');
  EXPECT_GE(H5Aread(attribute.get(), type.get(), value.data()), 0) << name;
  return text + value;
}

std::string ChunksText(hid_t array, hid_t creation) {
  hsize_t chunk[4] = {};
  unsigned flags = 0, level = 0;
  std::size_t values = 1;
  EXPECT_EQ(H5Pget_chunk(creation, 4, chunk), 4);
  EXPECT_EQ(H5Pget_nfilters(creation), 1);
  const H5Z_filter_t filter = H5Pget_filter2(creation, 0, &flags, &values, &level, 0, nullptr, nullptr);
  H5D_fill_time_t fill{};
  H5Pget_fill_time(creation, &fill);
  std::string text = Dump(chunk, sizeof(chunk)) + std::to_string(filter) + std::to_string(flags) +
                     std::to_string(level) + std::to_string(static_cast<int>(fill));
  hsize_t count = 0;
  const Hid space(H5Dget_space(array));
  EXPECT_GE(H5Dget_num_chunks(array, space.get(), &count), 0);
  text += " " + std::to_string(count) + " ";
  for (hsize_t k = 0; k < count; ++k) {
    hsize_t at[4] = {}, size = 0;
    haddr_t address = 0;
    unsigned filters_left_out = 0;
    EXPECT_GE(H5Dget_chunk_info(array, space.get(), k, at, &filters_left_out, &address, &size), 0) << k;
    text += Dump(at, sizeof(at));
    std::string stream(size, 'x');
    std::uint32_t mask = 0;
    EXPECT_GE(H5Dread_chunk(array, H5P_DEFAULT, at, &mask, stream.data()), 0) << k;
    text += std::to_string(mask) + stream;
  }
  return text;
}

std::string ArrayText(hid_t array) {
  const Hid type(H5Dget_type(array)), space(H5Dget_space(array)), creation(H5Dget_create_plist(array));
  std::string text = TypeAndExtents(type.get(), space.get());
  if (H5Pget_layout(creation.get()) == H5D_CHUNKED) text += ChunksText(array, creation.get());
  std::string values(H5Tget_size(type.get()) * static_cast<std::size_t>(H5Sget_simple_extent_npoints(space.get())),
                     'x');
  EXPECT_GE(H5Dread(array, type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  return text + values;
}

using Contents = std::map<std::string, std::string>;

herr_t Collect(hid_t root, const char* name, const H5O_info_t* info, void* out) {
  auto& contents = *static_cast<Contents*>(out);
  const Hid object(H5Oopen(root, name, H5P_DEFAULT));
  EXPECT_TRUE(object) << name;
  contents[name] = info->type == H5O_TYPE_DATASET ? ArrayText(object.get()) : "group";
  for (hsize_t i = 0; i < info->num_attrs; ++i) {
    char attribute[300] = {};
    H5Aget_name_by_idx(object.get(), ".", H5_INDEX_NAME, H5_ITER_INC, i, attribute, sizeof(attribute), H5P_DEFAULT);
    contents[std::string(name) + "@" + attribute] = AttributeText(object.get(), attribute);
  }
  return 0;
}

// Everything that the library finds: paths, attributes, types, extents, filters, values, chunks as they are.
Contents ContentsOf(const Bytes& bytes) {
  const HdfLock lock;
  const Hid access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_fapl_core(access.get(), 1 << 20, false);
  H5Pset_file_image(access.get(), const_cast<std::uint8_t*>(bytes.data()), bytes.size());
  const Hid file(H5Fopen("image.hdf5", H5F_ACC_RDONLY, access.get()));
  EXPECT_TRUE(file);
  Contents contents;
  if (file) {
    EXPECT_GE(H5Ovisit(file.get(), H5_INDEX_NAME, H5_ITER_INC, Collect, &contents), 0);
  }
  return contents;
}

Bytes Whole(const HdfImageBytes& image) {
  Bytes bytes = image.head;
  for (const auto stream : image.streams) bytes.insert(bytes.end(), stream.begin(), stream.end());
  return bytes;
}

void ExpectAsTheLibraryMakesIt(const Episode& episode) {
  const auto ours = EncodeEpisodeFile(episode), theirs = EncodeByLibrary(episode);
  ASSERT_THAT(ours, IsOk());
  ASSERT_THAT(theirs, IsOk());
  const Contents left = ContentsOf(*ours), right = ContentsOf(*theirs);
  std::vector<std::string> left_names, right_names;
  for (const auto& [name, text] : left) left_names.push_back(name);
  for (const auto& [name, text] : right) right_names.push_back(name);
  EXPECT_EQ(left_names, right_names);
  EXPECT_GT(left.size(), 40u);
  for (const auto& [name, text] : right) EXPECT_TRUE(!left.contains(name) || left.at(name) == text) << name;
}

TEST(HdfImage, IsForTheLibraryWhatItMakesItself) {
  for (const int steps : {2, 6, 50, 333}) {
    SCOPED_TRACE(steps);
    ExpectAsTheLibraryMakesIt(MakeSyntheticEpisode(SyntheticSpec(40, 24), 7, steps));
  }
  Episode bare = MakeSyntheticEpisode(SyntheticSpec(), 0, 2);
  bare.objects.clear();
  bare.cameras.clear();
  bare.states = {};
  bare.reference.clear();
  ExpectAsTheLibraryMakesIt(bare);
  Episode two = MakeSyntheticEpisode(SyntheticSpec(), 2, 9);
  two.cameras.push_back(two.cameras[0]);
  two.cameras[1].camera.name = "wrist";
  two.cameras[1].streams.clear();
  ExpectAsTheLibraryMakesIt(two);
}

// Blocks and bands that fit, that the last frames or rows do not fill, and of one frame or one row.
TEST(HdfImage, CutsFramesInAnyShape) {
  const Episode episode = MakeSyntheticEpisode(SyntheticSpec(20, 11), 7, 50);
  for (const codec::ChunkShape chunk :
       {codec::ChunkShape{1, 0}, {10, 11}, {5, 11}, {3, 4}, {4, 1}, {1, 10}, {7, 6}, {1, 1}}) {
    SCOPED_TRACE(fmt::format("{} frames x {} rows", chunk.frames, chunk.rows));
    ExpectAsTheLibraryMakesIt(Recut(episode, chunk));
  }
}

// A node of the index holds 64 streams: one leaf, a full one, two leaves, and three levels.
TEST(HdfImage, IndexesAnyNumberOfStreams) {
  for (const int frames : {63, 64, 65, 128, 4096, 4097, 4300}) {
    SCOPED_TRACE(frames);
    Episode episode = MakeSyntheticEpisode(SyntheticSpec(16, 16), 1, 2);
    CampaignSpec spec = SyntheticSpec(16, 16);
    spec.image_stride = 1;
    episode = MakeSyntheticEpisode(spec, 1, frames);
    ExpectAsTheLibraryMakesIt(Recut(episode, {2, 4}));  // twice as many streams
    episode = Recut(std::move(episode), {1, 0});
    ASSERT_EQ(episode.cameras[0].streams.size(), static_cast<std::size_t>(frames));
    ExpectAsTheLibraryMakesIt(episode);
  }
}

TEST(HdfImage, HoldsTextsOfAnyLengthInAsManyHeapsAsTheyNeed) {
  HdfImage image;
  HdfWriter library;
  const auto fill = [](auto& file) {
    file.Group("/a");
    for (int i = 0; i < 40; ++i)
      file.Attribute("/a", fmt::format("t{}", i).c_str(),
                     std::string_view(std::string(static_cast<std::size_t>(i * i * 10), 'x')));
    file.Attribute("/a", "long", std::string_view(std::string(300'000, 'y')));
    file.Attribute("/a", "umlaut", std::string_view("\u00e4\u20ac"));
    file.Attribute("/a", "cut", std::string_view("before\0behind", 13));
    file.Attribute("/a", "last", std::string_view());
    file.Array("/a/none", std::vector<float>{}, {3, 0});
    file.Array("/b/c/d", std::vector<std::int64_t>{1, -2, 3}, {3});
  };
  fill(image);
  fill(library);
  const auto ours = image.Finish();
  const auto theirs = library.Finish();
  ASSERT_THAT(ours, IsOk());
  ASSERT_THAT(theirs, IsOk());
  EXPECT_EQ(ContentsOf(Whole(*ours)), ContentsOf(*theirs));
}

TEST(HdfImage, SaysWhatDoesNotFit) {
  const auto failing = [](auto call) {
    HdfImage image;
    call(image);
    const auto made = image.Finish();
    EXPECT_FALSE(made);
    return made ? std::string() : made.error().message;
  };
  using testing::HasSubstr;
  EXPECT_THAT(failing([](HdfImage& image) { image.Array("/x", std::vector<float>{1, 2}, {3}); }), HasSubstr("/x"));
  EXPECT_THAT(failing([](HdfImage& image) { image.Attribute("/x", "a", 1.0); }), HasSubstr("/x"));
  EXPECT_THAT(failing([](HdfImage& image) {
                image.Array("/x", std::vector<float>{1}, {1});
                image.Array("/x", std::vector<float>{1}, {1});
              }),
              HasSubstr("/x"));
  const Bytes bytes(8, 1);
  const std::span<const std::uint8_t> stream = bytes;
  EXPECT_THAT(failing([](HdfImage& image) { image.Frames("/x", {2, 2, {}}, 1, {{}}); }), HasSubstr("of 0 bytes"));
  for (const auto& [layout, count] : {std::pair<codec::FrameLayout, std::size_t>{{2, 2, {}}, 2},
                                      {{2, 2, {}}, 0},
                                      {{2, 2, {1, 3}}, 1},
                                      {{0, 2, {}}, 1},
                                      {{2, 2, {2, 2}}, 1}})
    EXPECT_THAT(
        failing([&, layout = layout, count = count](HdfImage& image) { image.Frames("/x", layout, count, {stream}); }),
        HasSubstr("1 streams for"))
        << count;
  EXPECT_THAT(failing([](HdfImage& image) { image.Group("/" + std::string(256, 'n')); }), HasSubstr("255"));
}

}  // namespace hdf_image_test
}  // namespace etude::store::internal
