// SPDX-License-Identifier: Apache-2.0
// Tests services/spec/task_files.cc
#include "services/spec/task_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace etude {
namespace task_files_test {

using ::testing::HasSubstr;
using ::testing::Not;

// before, who had edited a task file was told of another version of the program
TEST(WhyHashDiffers, NamesTheTaskFilesThatMayBeOthers) {
  CampaignSpec spec;
  spec.tasks = {"pick", "push+others"};
  EXPECT_TRUE(TaskFilesOf(spec).empty());
  EXPECT_THAT(WhyHashDiffers(spec), HasSubstr("knows other keys"));
  EXPECT_THAT(WhyHashDiffers(spec), Not(HasSubstr(".yaml")));
  spec.tasks = {"mine/stack.yaml", "pick", "mine/stack.yaml+others", "mine/fetch.yaml+obstacle"};
  EXPECT_EQ(TaskFilesOf(spec), (std::vector<std::string>{"mine/stack.yaml", "mine/fetch.yaml"}));
  EXPECT_THAT(WhyHashDiffers(spec), HasSubstr("'mine/stack.yaml', 'mine/fetch.yaml' are not what they were then"));
}

}  // namespace task_files_test
}  // namespace etude
