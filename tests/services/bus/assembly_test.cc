// SPDX-License-Identifier: Apache-2.0
#include "services/bus/assembly.h"

#include <gtest/gtest.h>

#include "tests/services/bus/two_processes.h"

namespace etude::bus {
namespace assembly_test {

using Added = Assembly::Added;

TEST(Assembly, TakesChunksInAnyOrder) {
  const auto bytes = MakeBytes(1001, 1);
  Assembly assembly(bytes.size(), 100);
  ASSERT_EQ(assembly.count(), 11u);
  for (const std::uint32_t index : {10u, 0u, 2u, 1u, 9u, 8u, 3u, 4u, 7u, 6u}) {
    EXPECT_EQ(assembly.Add(index, ChunkOf(bytes, 100, index)), Added::kNew);
    EXPECT_FALSE(assembly.complete());
  }
  EXPECT_EQ(assembly.Missing(10), std::vector<std::uint32_t>{5});
  EXPECT_EQ(assembly.next(), 5u);
  EXPECT_EQ(assembly.Add(5, ChunkOf(bytes, 100, 5)), Added::kNew);
  ASSERT_TRUE(assembly.complete());
  EXPECT_EQ(assembly.Digest(), Sha256Of(bytes));
  EXPECT_EQ(assembly.TakeBytes(), bytes);
}

TEST(Assembly, TellsRepeatsAndMalformedChunks) {
  const auto bytes = MakeBytes(250, 2);
  Assembly assembly(bytes.size(), 100);
  EXPECT_EQ(assembly.Add(3, ChunkOf(bytes, 100, 0)), Added::kMalformed);  // no such chunk
  EXPECT_EQ(assembly.Add(2, ChunkOf(bytes, 100, 0)), Added::kMalformed);  // the last one has 50
  EXPECT_EQ(assembly.Add(0, ChunkOf(bytes, 100, 2)), Added::kMalformed);
  EXPECT_EQ(assembly.Add(0, ChunkOf(bytes, 100, 0)), Added::kNew);
  EXPECT_EQ(assembly.Add(0, ChunkOf(bytes, 100, 0)), Added::kRepeat);
  EXPECT_EQ(assembly.Add(2, ChunkOf(bytes, 100, 2)), Added::kNew);
  EXPECT_EQ(assembly.Add(2, ChunkOf(bytes, 100, 2)), Added::kRepeat);
  EXPECT_EQ(assembly.Missing(10), std::vector<std::uint32_t>{1});
}

TEST(Assembly, AnEmptyBlobIsComplete) {
  Assembly assembly(0, 100);
  EXPECT_TRUE(assembly.complete());
  EXPECT_EQ(assembly.Digest(), Sha256Of({}));
}

TEST(Shape, RefusesWhatDoesNotFitTogether) {
  EXPECT_TRUE(ShapeIsSound(0, 1, 0));
  EXPECT_TRUE(ShapeIsSound(250, 100, 3));
  EXPECT_FALSE(ShapeIsSound(250, 100, 2));
  EXPECT_FALSE(ShapeIsSound(250, 0, 0));
  EXPECT_FALSE(ShapeIsSound(250, 512 * 1024 + 1, 1));
  EXPECT_FALSE(ShapeIsSound(~0ull, 1024, 0));  // the sum in the count would overflow
}

}  // namespace assembly_test
}  // namespace etude::bus
