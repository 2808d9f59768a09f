// SPDX-License-Identifier: Apache-2.0
// Tests services/core/pinned_process.cc
#include "services/core/pinned_process.h"

#include <gtest/gtest.h>

namespace etude {
namespace pinned_process_test {

TEST(JoinTunables, TheFirstHoldsWhereBothNameOne) {
  EXPECT_EQ(JoinTunables("", "glibc.a.b=1:glibc.a.c=2"), "glibc.a.b=1:glibc.a.c=2");
  EXPECT_EQ(JoinTunables("glibc.a.b=1", ""), "glibc.a.b=1");
  EXPECT_EQ(JoinTunables("glibc.a.c=3:glibc.a.bc=4", "glibc.a.b=1:glibc.a.c=2"),
            "glibc.a.c=3:glibc.a.bc=4:glibc.a.b=1");
  const std::string joined = JoinTunables("glibc.a.c=3", "glibc.a.b=1:glibc.a.c=2");
  EXPECT_EQ(JoinTunables(joined, "glibc.a.b=1:glibc.a.c=2"), joined) << "started again once, not for ever";
}

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
