// SPDX-License-Identifier: Apache-2.0
// Tests services/cli/up_config.h
#include "services/cli/up_config.h"

#include <gmock/gmock.h>

#include "services/core/config_reference.h"

namespace etude::cli {
namespace up_config_test {

TEST(UpConfig, SaysOfEveryKeyWhatItMeansAndInWhichUnit) {
  EXPECT_THAT(MissingFromReference(ConfigReference<UpConfig>()), testing::IsEmpty());
}

}  // namespace up_config_test
}  // namespace etude::cli
