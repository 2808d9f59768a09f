// SPDX-License-Identifier: Apache-2.0
// The fallback draws the same picture; a machine without EGL must still work.
#include <gmock/gmock.h>

#include <algorithm>
#include <cstdlib>

#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/renderer.h"

namespace etude::sim {
namespace osmesa_test {

std::vector<std::uint8_t> Take(Renderer& renderer, const World& world) {
  std::vector<std::uint8_t> picture(224 * 224 * 3);
  renderer.Render(world, picture);
  return picture;
}

/// A machine whose EGL finds no driver.
struct NoEgl {
  NoEgl() { setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent", 1); }
} no_egl;

TEST(OsMesa, WithoutEglTheErrorSaysWhatToInstall) {
  const auto renderer = Renderer::Open(FullScene(), {.backend = "egl"});
  ASSERT_FALSE(renderer);
  EXPECT_EQ(renderer.error().code, Code::kUnavailable);
  EXPECT_THAT(renderer.error().message,
              testing::AllOf(testing::HasSubstr("EGL:"), testing::HasSubstr("libgl1-mesa-dri")));
}

TEST(OsMesa, TakesOverWhereEglFails) {
  auto renderer = Renderer::Open(FullScene());
  ASSERT_TRUE(renderer) << renderer.error().message;
  EXPECT_EQ(renderer->backend(), "osmesa");
}

TEST(OsMesa, DrawsAlikeAgainAndAgain) {
  World world(FullScene());
  auto renderer = Renderer::Open(FullScene(), {.backend = "osmesa"});
  ASSERT_TRUE(renderer) << renderer.error().message;
  EXPECT_EQ(renderer->backend(), "osmesa");
  const auto first = Take(*renderer, world);
  EXPECT_GT(std::count_if(first.begin(), first.end(), [](int v) { return v > 60; }), 224 * 224 / 2);
  EXPECT_EQ(Take(*renderer, world), first);
  renderer = Renderer::Open(FullScene(), {.backend = "osmesa"});  // the old context goes after the new came
  ASSERT_TRUE(renderer) << renderer.error().message;
  EXPECT_EQ(Take(*renderer, world), first);
}

}  // namespace osmesa_test
}  // namespace etude::sim
