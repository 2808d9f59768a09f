// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/shard.cc
#include "services/spec/shard.h"

#include <gtest/gtest.h>

namespace etude {
namespace shard_test {

TEST(Shard, ShardsTogetherHaveEachEpisodeOnce) {
  for (std::uint32_t count : {1u, 2u, 3u, 7u})
    for (std::uint64_t episodes = 1; episodes < 20; ++episodes) {
      std::uint64_t together = 0;
      for (std::uint32_t number = 1; number <= count; ++number) {
        const Shard shard{number, count};
        std::uint64_t own = 0;
        for (std::uint64_t index = 0; index < episodes; ++index) own += shard.Has(index);
        EXPECT_EQ(shard.CountOf(episodes), own) << shard.text() << " of " << episodes;
        together += own;
      }
      EXPECT_EQ(together, episodes) << count;
    }
}

TEST(Shard, IsWrittenAsItIsRead) {
  EXPECT_EQ(ParseShard("2/3").value(), (Shard{2, 3}));
  EXPECT_EQ(ParseShard("2/3")->text(), "2/3");
  EXPECT_TRUE(ParseShard("1/1")->whole());
  for (const char* text :
       {"", "2", "/", "0/3", "4/3", "-1/3", "1/0", "1/1001", "1/3 ", "1/3/4", "a/b", "99999999999/3"}) {
    const auto shard = ParseShard(text);
    ASSERT_FALSE(shard) << text;
    EXPECT_EQ(shard.error().code, Code::kInvalidArgument);
    EXPECT_NE(shard.error().message.find("NUMBER/COUNT"), std::string::npos);
  }
}

}  // namespace shard_test
}  // namespace etude
