// SPDX-License-Identifier: Apache-2.0
// Tests trainer/policy/torch_error.cc
#include "trainer/policy/torch_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>

#include "trainer/policy/torch.h"

namespace etude::policy {
namespace {

using testing::HasSubstr;
using testing::Not;

template <class Work>
Error Thrown(Work&& work, Code otherwise = Code::kInternal) {
  try {
    work();
  } catch (const std::exception& error) {
    return TorchError("train", error, otherwise);
  }
  return {Code::kNotFound, "nothing was thrown"};
}

TEST(TorchError, SaysWhatTorchRefusesWithoutItsBacktrace) {
  const auto refused = [] { torch::zeros({2, 3}).matmul(torch::zeros({2, 3})); };
  const Error error = Thrown(refused);
  EXPECT_EQ(error.code, Code::kInternal);
  EXPECT_THAT(error.message, HasSubstr("train: mat1 and mat2 shapes cannot be multiplied"));
  EXPECT_THAT(error.message, Not(HasSubstr("frame #")));
  EXPECT_EQ(Thrown(refused, Code::kCorrupt).code, Code::kCorrupt);
}

TEST(TorchError, MemoryThatIsNotThereIsUnavailableWhateverItsType) {
  const Error torch = Thrown([] { (void)torch::empty({std::int64_t{1} << 50}); }, Code::kCorrupt);
  EXPECT_EQ(torch.code, Code::kUnavailable) << torch.message;
  EXPECT_THAT(torch.message, HasSubstr("train: out of memory: "));
  EXPECT_EQ(Thrown([] { throw std::bad_alloc(); }).code, Code::kUnavailable);
}

}  // namespace
}  // namespace etude::policy
