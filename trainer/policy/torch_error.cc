// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/torch_error.h"

#include <fmt/format.h>

#include <new>
#include <string>

#include "trainer/policy/torch.h"

namespace etude::policy {
namespace {

// torch has a type for a GPU's memory alone
bool IsOutOfMemory(const std::exception& thrown, std::string_view words) {
  return dynamic_cast<const c10::OutOfMemoryError*>(&thrown) != nullptr ||
         dynamic_cast<const std::bad_alloc*>(&thrown) != nullptr ||
         words.find("DefaultCPUAllocator") != std::string_view::npos;
}

}  // namespace

Error TorchError(std::string_view what, const std::exception& thrown, Code otherwise) {
  const auto* torch = dynamic_cast<const c10::Error*>(&thrown);
  const std::string words = torch != nullptr ? torch->what_without_backtrace() : thrown.what();
  const bool memory = IsOutOfMemory(thrown, words);
  return {memory ? Code::kUnavailable : otherwise,
          fmt::format("{}: {}{}", what, memory ? "out of memory: " : "", words)};
}

}  // namespace etude::policy
