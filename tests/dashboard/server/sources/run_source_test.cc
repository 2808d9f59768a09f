// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/sources/run_source.cc
#include "dashboard/server/sources/run_source.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include "services/core/hash.h"
#include "services/store/safetensors.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::sources {
namespace run_source_test {

OrderedJson Train(std::uint64_t step, OrderedJson loss) {
  return {{"kind", "train"},
          {"step", step},
          {"elapsed_s", 1.0},
          {"time", 100.0 + static_cast<double>(step)},
          {"loss", loss}};
}

TEST(MetricsTable, KeepsKindsApartAndCountsNulls) {
  MetricsTable table;
  table.Take(Train(50, 1.5));
  table.Take(Train(100, nullptr));
  table.Take({{"kind", "valid"}, {"step", 100}, {"TAR3D.cm", 2.0}, {"loss", 9.0}});
  const auto& loss = table.series().at("train/loss");
  EXPECT_EQ(loss.step, (std::vector<double>{50, 100}));
  EXPECT_TRUE(std::isnan(loss.value[1]));
  EXPECT_EQ(loss.nulls, 1u);
  EXPECT_EQ(table.series().at("valid/loss").nulls, 0u);
  EXPECT_FALSE(table.Last("train/loss")) << "the newest is not finite";
  EXPECT_EQ(table.Last("valid/TAR3D.cm"), 2.0);
  EXPECT_EQ(table.lives().size(), 1u) << "validation at the step of training is no resume";
}

TEST(MetricsTable, AResumedLifeSupersedesTheOneBefore) {
  MetricsTable table;
  for (const std::uint64_t step : {50, 100, 150, 200}) table.Take(Train(step, static_cast<double>(step)));
  table.Take(Train(150, -1.0));
  EXPECT_EQ(table.series().at("train/loss").step, (std::vector<double>{50, 100, 150}));
  EXPECT_EQ(table.series().at("train/loss").value.back(), -1.0);
  ASSERT_EQ(table.lives().size(), 2u);
  EXPECT_EQ(table.lives()[1].from_step, 150u);
  const auto lines = table.LinesAfter(0, 10);
  ASSERT_EQ(lines.size(), 3u) << "50, 100 and the new 150";
  EXPECT_EQ(lines.back()["loss"], -1.0);
}

TEST(MetricsTable, AnEndLineSaysHowAndGoingOnTakesItBack) {
  MetricsTable table;
  table.Take(Train(50, 1.0));
  table.Take({{"kind", "end"}, {"step", 50}, {"cause", "stopped"}});
  ASSERT_TRUE(table.end());
  EXPECT_EQ(table.end()->cause, "stopped");
  table.Take(Train(60, 1.0));
  EXPECT_FALSE(table.end());
}

TEST(Bucketed, KeepsExtremesThatEvenSamplingWouldLose) {
  std::vector<double> x, value;
  for (int i = 0; i < 1000; ++i) x.push_back(i), value.push_back(i == 517 ? 100 : i == 300 ? -50 : 1);
  const auto buckets = Bucketed(x, value, 0, 1e9, 10);
  ASSERT_EQ(buckets.x.size(), 10u);
  EXPECT_EQ(*std::max_element(buckets.max.begin(), buckets.max.end()), 100);
  EXPECT_EQ(*std::min_element(buckets.min.begin(), buckets.min.end()), -50);
  for (const double last : buckets.last) EXPECT_EQ(last, 1);
  EXPECT_EQ(buckets.x.back(), 999);
}

// before, they were passed over, and a line was drawn straight across
TEST(Bucketed, ValuesThatAreNotFiniteAreEntriesOfTheirOwn) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  std::vector<double> x, value;
  for (int i = 0; i < 100; ++i) x.push_back(i), value.push_back(i);
  value[13] = nan, value[14] = infinity;         // inside a bucket
  for (int i = 40; i < 60; ++i) value[i] = nan;  // two buckets of nothing else
  value[99] = nan;                               // the newest
  const auto buckets = Bucketed(x, value, 0, 99, 10);
  EXPECT_TRUE(std::ranges::is_sorted(buckets.x));
  std::vector<double> gaps;
  double most = 0;
  ASSERT_EQ(buckets.last.size(), buckets.x.size());
  ASSERT_EQ(buckets.index.size(), buckets.x.size());
  for (std::size_t i = 0; i < buckets.x.size(); ++i) {
    EXPECT_EQ(x[buckets.index[i]], buckets.x[i]);
    if (std::isfinite(buckets.last[i]))
      most = std::max(most, buckets.max[i]);
    else
      gaps.push_back(buckets.x[i]);
  }
  EXPECT_EQ(gaps, (std::vector<double>{14, 49, 59, 99}));
  EXPECT_EQ(most, 98) << "what is finite is whole";
  EXPECT_EQ(buckets.x.size(), 12u) << "ten buckets, two of which have both";
}

TEST(Bucketed, FewValuesAreThemselvesAndGapsStayGaps) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto buckets = Bucketed({1, 2, 3, 4}, {10, nan, 30, 40}, 2, 3.5, 100);
  EXPECT_EQ(buckets.x, (std::vector<double>{2, 3}));
  EXPECT_TRUE(std::isnan(buckets.last[0]));
  EXPECT_EQ(buckets.last[1], 30);
  EXPECT_TRUE(Bucketed({}, {}, 0, 1, 10).x.empty());
}

store::Safetensors Checkpoint(const std::string& step) {
  store::Safetensors content;
  content.metadata = {{"step", step}, {"stage", "2"}, {"stages", "2"}};
  content.tensors["modules.LANG.w"] = {store::DType::kF32, {2, 3}, std::vector<std::uint8_t>(24)};
  content.tensors["image.a"] = {store::DType::kF32, {4}, std::vector<std::uint8_t>(16)};
  return content;
}

TEST(RunSource, ReadsHeadersChannelsAndHashes) {
  TemporaryFolder folder;
  const Path checkpoints = folder / "run" / "checkpoints";
  ASSERT_THAT(WriteFileAtomically(folder / "run" / "config.yaml", "steps: 100\n"), IsOk());
  ASSERT_THAT(WriteFileAtomically(folder / "run" / "metrics.jsonl", Train(100, 0.5).dump() + "\n"), IsOk());
  ASSERT_THAT(MakeFolders(checkpoints), IsOk());
  ASSERT_THAT(store::WriteSafetensors(checkpoints / "00000050.safetensors", Checkpoint("50")), IsOk());
  ASSERT_THAT(store::WriteSafetensors(checkpoints / "00000100.safetensors", Checkpoint("100")), IsOk());
  ASSERT_THAT(WriteFileAtomically(checkpoints / "00000150.safetensors", "short"), IsOk());
  std::filesystem::create_symlink("00000100.safetensors", checkpoints / "best.safetensors");
  std::filesystem::create_symlink("/etc/passwd", checkpoints / "evil.safetensors");
  RunSource source({Kind::kRun, "run", "run", folder / "run", "run", ""});

  auto view = source.View().value();
  ASSERT_EQ(view->checkpoints.size(), 3u) << "links are channels, not files";
  EXPECT_EQ(view->checkpoints[0].file, "00000150.safetensors");
  EXPECT_FALSE(view->checkpoints[0].error.empty());
  EXPECT_EQ(view->checkpoints[1].channels, (std::vector<std::string>{"best"}));
  EXPECT_EQ(view->checkpoints[1].parameters.at("LANG"), 6u);
  EXPECT_EQ(view->checkpoints[1].parameters.at("image"), 4u);
  while (source.HashNext()) {
  }
  view = source.View().value();
  const auto bytes = ReadBinaryFile(checkpoints / "00000100.safetensors").value();
  EXPECT_EQ(view->checkpoints[1].sha256, Sha256Hex(bytes));
}

// in the order of the folder, 500 of them were shown, whether the newest was among them or not
TEST(RunSource, OfManyCheckpointsTheNewestAreShownAndThoseThatAChannelNames) {
  TemporaryFolder folder;
  const Path checkpoints = folder / "run" / "checkpoints";
  ASSERT_THAT(WriteFileAtomically(folder / "run" / "config.yaml", "steps: 100\n"), IsOk());
  ASSERT_THAT(MakeFolders(checkpoints), IsOk());
  for (int step = 1; step <= 520; ++step)
    std::ofstream(checkpoints / fmt::format("{:08}.safetensors", step)) << "short";
  std::filesystem::create_symlink("00000003.safetensors", checkpoints / "best.safetensors");
  RunSource source({Kind::kRun, "run", "run", folder / "run", "run", ""});
  const auto view = source.View().value();
  ASSERT_EQ(view->checkpoints.size(), 501u);
  EXPECT_EQ(view->checkpoints.front().file, "00000520.safetensors");
  EXPECT_EQ(view->checkpoints[499].file, "00000021.safetensors");
  EXPECT_EQ(view->checkpoints.back().file, "00000003.safetensors");
  EXPECT_EQ(view->checkpoints.back().channels, (std::vector<std::string>{"best"}));
}

}  // namespace run_source_test
}  // namespace etude::sources
