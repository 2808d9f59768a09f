// SPDX-License-Identifier: Apache-2.0
// The fallback draws the same picture; a machine without EGL must still work.
#include <gmock/gmock.h>

#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/renderer.h"

namespace etude::sim {
namespace {

std::vector<std::uint8_t> Take(Renderer& renderer, const World& world) {
  std::vector<std::uint8_t> picture(224 * 224 * 3);
  renderer.Render(world, picture);
  return picture;
}

TEST(OsMesa, DrawsThenMakesWayForNobody) {
  World world(FullScene());
  auto renderer = Renderer::Open(FullScene(), {.backend = "osmesa"});
  ASSERT_TRUE(renderer) << renderer.error().message;
  EXPECT_EQ(renderer->backend(), "osmesa");
  const auto first = Take(*renderer, world);
  EXPECT_GT(std::count_if(first.begin(), first.end(), [](int v) { return v > 60; }), 224 * 224 / 2);
  EXPECT_EQ(Take(*renderer, world), first);
}

}  // namespace
}  // namespace etude::sim
