// SPDX-License-Identifier: Apache-2.0
// Tests services/core/pinned_process.cc
#include "services/core/pinned_process.h"

#include <gtest/gtest.h>

namespace etude {
namespace pinned_process_test {

TEST(PinnedEnvironment, MasksTheVariantsOfLibmAndKeepsOtherTunables) {
  const auto none = PinnedEnvironment([](const char*) -> const char* { return nullptr; });
  EXPECT_EQ(none.at("GLIBC_TUNABLES"), "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F");

  const auto others = PinnedEnvironment([](const char* name) -> const char* {
    return std::string_view(name) == "GLIBC_TUNABLES" ? "glibc.malloc.arena_max=1:glibc.cpu.hwcaps=-SSE4_2" : "x";
  });
  EXPECT_EQ(others.at("GLIBC_TUNABLES"), none.at("GLIBC_TUNABLES") + ":glibc.malloc.arena_max=1");
  EXPECT_EQ(others.at("GALLIUM_OVERRIDE_CPU_CAPS"), none.at("GALLIUM_OVERRIDE_CPU_CAPS")) << "whatever was asked for";
}

TEST(PinnedEnvironment, IsSettledOnceItIsSet) {
  static std::map<std::string, std::string> set;
  set = PinnedEnvironment([](const char*) -> const char* { return nullptr; });
  EXPECT_EQ(PinnedEnvironment([](const char* name) -> const char* {
              const auto found = set.find(name);
              return found == set.end() ? nullptr : found->second.c_str();
            }),
            set)
      << "a program is started again once, not for ever";
}

}  // namespace pinned_process_test
}  // namespace etude
