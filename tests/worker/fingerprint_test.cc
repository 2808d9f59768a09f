// SPDX-License-Identifier: Apache-2.0
// Tests worker/fingerprint.cc. What its lines depend on is shown with processes in
// tests/integration/campaign_bytes_test.
#include "worker/fingerprint.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "services/spec/content_version.h"
#include "worker/sim/scene.h"
#include "worker/sim/world.h"

namespace etude {
namespace fingerprint_test {

#if defined(__x86_64__)
__attribute__((noinline, target("fma"), optimize("O2"))) double ProductAndSum(double a, double b, double c) {
  return a * b + c;
}

// deploy/cmake/functions.cmake: where a compiler may fuse them, one rounding is left out
TEST(FloatingPoint, ProductsAndSumsAreRoundedApart) {
  if (!__builtin_cpu_supports("fma")) GTEST_SKIP() << "this CPU fuses nothing";
  const volatile double a = 1 + 0x1p-30, b = 1 - 0x1p-30, c = -1;
  EXPECT_EQ(ProductAndSum(a, b, c), 0) << "fused it is -2^-60";
}
#endif

TEST(LibmProbe, IsTheSameEachTimeAndOnEachThread) {
  const std::string first = LibmProbe();
  EXPECT_EQ(first.size(), 64u);
  EXPECT_EQ(LibmProbe(), first);
  std::string elsewhere;
  std::thread([&] { elsewhere = LibmProbe(); }).join();
  EXPECT_EQ(elsewhere, first);
}

TEST(TakeFingerprint, SaysEveryLineAndTheSameOnOneMachine) {
  const auto first = TakeFingerprint({});
  ASSERT_TRUE(first) << first.error().message;
  std::vector<std::string> names;
  for (const auto& [name, value] : *first) {
    names.push_back(name);
    EXPECT_FALSE(value.empty()) << name;
  }
  EXPECT_EQ(names, (std::vector<std::string>{"content", "libraries", "gl", "picture", "physics", "libm", "deflated"}));
  EXPECT_EQ((*first)[0].second, std::to_string(kContentVersion));
  EXPECT_NE((*first)[1].second.find("libmujoco"), std::string::npos) << (*first)[1].second;
  EXPECT_EQ((*first)[2].second.find(" bits"), std::string::npos) << "as wide as the CPU's vectors are";
  EXPECT_EQ((*first)[5].second, LibmProbe());
  const auto second = TakeFingerprint({});
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_EQ(*second, *first);
  EXPECT_FALSE(campaign::FirstDifference(*first, *second, "bytes"));
}

TEST(Fingerprints, AreTakenOnceForEachWhoDraws) {
  Fingerprints fingerprints{sim::RendererConfig{}};
  CampaignSpec spec;
  const auto first = fingerprints.Of(spec);
  ASSERT_TRUE(first) << first.error().message;
  spec.seed = 7;
  const auto other = fingerprints.Of(spec);
  ASSERT_TRUE(other);
  EXPECT_EQ(*other, *first);
}

// Threads of llvmpipe after a picture; -1: something else draws here.
int DrawingThreads(const char* wanted) {
  ::setenv("LP_NUM_THREADS", wanted, 1);
  const auto scene = sim::Scene::Build(SceneSpec{});
  if (!scene) return -1;
  auto renderer = sim::Renderer::Open(*scene, {});
  if (!renderer || renderer->gl_renderer().find("llvmpipe") == std::string::npos) return -1;
  sim::World world(*scene);
  world.Reset();
  world.Forward();
  std::vector<std::uint8_t> rgb(static_cast<std::size_t>((*scene)->camera().width) * (*scene)->camera().height * 3);
  renderer->Render(world, rgb);
  int threads = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream file(task.path() / "comm");
    std::string name;
    std::getline(file, name);
    threads += name.starts_with("llvmpipe");
  }
  return threads;
}

// The mask by which campaign_bytes_test shows that pictures do not depend on them is no empty one.
TEST(DrawingThreadsDeathTest, AreAsManyAsTheEnvironmentSays) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  constexpr int kOtherDriver = 100;
  for (const int wanted : {1, 4}) {
    EXPECT_EXIT(
        {
          const int found = DrawingThreads(std::to_string(wanted).c_str());
          ::_exit(found == wanted || found < 0 ? 0 : kOtherDriver + found);
        },
        ::testing::ExitedWithCode(0), "");
  }
}

}  // namespace fingerprint_test
}  // namespace etude
