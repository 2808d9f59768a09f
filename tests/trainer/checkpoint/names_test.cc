// SPDX-License-Identifier: Apache-2.0
// Tests trainer/checkpoint/names.cc
#include "trainer/checkpoint/names.h"

#include <gtest/gtest.h>

namespace etude::checkpoint {
namespace names_test {

TEST(Names, SortAsStepsDo) {
  EXPECT_LT(FileNameOf(999), FileNameOf(1000));
  EXPECT_EQ(LinkOf("x/checkpoints", kLatest), Path("x/checkpoints/latest.safetensors"));
}

}  // namespace names_test
}  // namespace etude::checkpoint
