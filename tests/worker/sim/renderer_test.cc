// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/renderer.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numeric>

#include "tests/support/sketch_robot.h"
#include "tests/worker/sim/scene_fixture.h"
#include "worker/sim/gl_context.h"

namespace etude::sim {
namespace renderer_test {

using Picture = std::vector<std::uint8_t>;

Renderer OpenOrDie() {
  auto renderer = Renderer::Open(FullScene());
  if (!renderer) {
    ADD_FAILURE() << renderer.error().message;
    std::abort();
  }
  return std::move(*renderer);
}

Picture Blank(const Camera& camera) { return Picture(static_cast<std::size_t>(camera.width) * camera.height * 3); }

Picture Take(Renderer& renderer, const World& world) {
  Picture picture = Blank(renderer.camera());
  renderer.Render(world, picture);
  return picture;
}

/// The body that each pixel of a picture of 224 px shows.
std::vector<std::int32_t> Segment(Renderer& renderer, const World& world) {
  std::vector<std::int32_t> ids(224 * 224);
  renderer.RenderSegmentation(world, ids);
  return ids;
}

double Mean(const Picture& picture) {
  return std::accumulate(picture.begin(), picture.end(), 0.0) / static_cast<double>(picture.size());
}

/// Mean pixel (u, v) of a body's mask, NaN without one.
Eigen::Vector2d Centroid(const std::vector<std::int32_t>& ids, int width, std::int32_t id) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] != id) continue;
    sum += Eigen::Vector2d(static_cast<double>(i % width) + 0.5, static_cast<double>(i / width) + 0.5);
    ++count;
  }
  return sum / count;
}

TEST(Renderer, SameStateSameBytes) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  EXPECT_THAT(renderer.backend(), testing::AnyOf("egl", "osmesa"));
  EXPECT_FALSE(renderer.gl_renderer().empty());
  const Picture first = Take(renderer, world);
  EXPECT_GT(Mean(first), 20);
  EXPECT_EQ(Take(renderer, world), first);

  // segmentation and another renderer in between change nothing
  Segment(renderer, world);
  Renderer other = OpenOrDie();
  EXPECT_EQ(Take(other, world), first);
  EXPECT_EQ(Take(renderer, world), first);

  world.Step({world.X_WE(), 0}, Vector6d::Zero());
  world.SetObject("coke", {{0.1, 0.1, 0.2}, Eigen::Quaterniond::Identity()});
  world.Forward();
  EXPECT_NE(Take(renderer, world), first);
  world.Reset();
  EXPECT_EQ(Take(renderer, world), first);
}

TEST(Renderer, ProjectionAgreesWithTheCamera) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Camera& camera = FullScene()->camera();
  std::vector<std::int32_t> ids(static_cast<std::size_t>(camera.width) * camera.height);
  // bodies are numbered as MuJoCo does: find each by what its neighbourhood shows when it alone is
  // moved away
  for (const std::string name : {"cube", "coke", "pepsi"})
    for (const Eigen::Vector2d& at : {Eigen::Vector2d(-0.35, 0.2), {0.0, 0.45}, {0.35, 0.3}}) {
      world.Reset();
      for (const ObjectInfo& object : FullScene()->objects())
        world.SetObject(object.name, {{0, -3, 1}, Eigen::Quaterniond::Identity()});
      const Pose X{{at.x(), at.y(), 0.10}, Eigen::Quaterniond::Identity()};
      world.SetObject(name, X);
      world.Forward();
      renderer.RenderSegmentation(world, ids);
      const Eigen::Vector2d seen = Centroid(ids, camera.width, world.BodyId(name));
      EXPECT_LT((seen - camera.Project(X.p)).norm(), 1.0) << name << " at " << at.transpose();
    }
}

TEST(Renderer, TopRowIsFar) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  auto ids = Segment(renderer, world);
  EXPECT_TRUE(std::all_of(ids.begin(), ids.begin() + 224, [](int id) { return id == -1; })) << "background above";
  const auto base = Centroid(ids, 224, world.BodyId("shoulder"));
  const auto can = Centroid(ids, 224, world.BodyId("coke"));
  EXPECT_LT(base.y(), can.y()) << "the robot stands behind the objects";
}

TEST(Renderer, DepthIsTheDistanceAlongTheViewingDirection) {
  World world(FullScene());
  for (const ObjectInfo& object : FullScene()->objects())
    world.SetObject(object.name, {{0, -3, 1}, Eigen::Quaterniond::Identity()});
  world.SetObject("milk", {{0.3, 0.4, 0.3}, Eigen::Quaterniond::Identity()});
  world.Forward();
  Renderer renderer = OpenOrDie();
  const Camera& camera = FullScene()->camera();
  std::vector<float> depth(static_cast<std::size_t>(camera.width) * camera.height);
  renderer.RenderDepth(world, depth);
  const auto at = [&](const Eigen::Vector3d& p) {
    const Eigen::Vector2d pixel = camera.Project(p);
    return depth[static_cast<std::size_t>(pixel.y()) * camera.width + static_cast<std::size_t>(pixel.x())];
  };
  const auto along = [&](const Eigen::Vector3d& p) { return -(camera.X_WC.inverse() * p).z(); };
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(-0.4, 0.3, 0), {0.1, 0.5, 0}, {-0.2, -0.2, 0}})
    EXPECT_NEAR(at(p), along(p), 0.015) << p.transpose();  // a pixel covers 8 to 15 mm of the table
  EXPECT_NEAR(at({0.3, 0.4, 0.3}), along({0.3, 0.4, 0.3}), 0.04) << "its near side is half of its depth closer";
  EXPECT_GT(depth[0], 10) << "nothing there: the far plane";
  const Picture before = Take(renderer, world);
  renderer.RenderDepth(world, depth);
  EXPECT_EQ(Take(renderer, world), before);
}

TEST(Renderer, ViewOfTheSceneCameraIsThePicture) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture picture = Take(renderer, world);
  renderer.SetCamera(FullScene()->camera());
  const Picture view = Take(renderer, world);
  double difference = 0;
  for (std::size_t i = 0; i < view.size(); ++i) difference += std::abs(int{view[i]} - int{picture[i]});
  EXPECT_LT(difference / static_cast<double>(view.size()), 0.1);
}

TEST(Renderer, LightGainDarkensAndComesBack) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  renderer.SetAppearance({.light = {0.6, 0.6, 0.6}});
  EXPECT_LT(Mean(Take(renderer, world)), 0.8 * Mean(normal));
  renderer.SetAppearance({});
  EXPECT_EQ(Take(renderer, world), normal);
}

TEST(Renderer, AppearanceIsDrawnFromTheSeed) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  const auto dressed = [&](double strength, std::uint64_t seed) {
    Rng rng(seed);
    renderer.SetAppearance(DrawAppearance(strength, FullScene()->body_count(), rng));
    return Take(renderer, world);
  };
  EXPECT_EQ(dressed(0, 1), normal);
  const Picture first = dressed(0.5, 1);
  EXPECT_NE(first, normal);
  EXPECT_NE(dressed(0.5, 2), first);
  EXPECT_EQ(dressed(0.5, 1), first);
}

TEST(Renderer, TintColoursOneObject) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  auto ids = Segment(renderer, world);
  Appearance appearance;
  const int milk = world.BodyId("milk");
  appearance.tint.assign(static_cast<std::size_t>(milk) + 1, Eigen::Vector3d::Ones());
  appearance.tint.back() = {0.2, 1, 1};
  renderer.SetAppearance(appearance);
  const Picture tinted = Take(renderer, world);
  int changed = 0;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const bool differs = tinted[3 * i] != normal[3 * i];
    changed += differs;
    if (differs) {
      EXPECT_EQ(ids[i], milk);
    }
  }
  EXPECT_GT(changed, 50);
}

TEST(Renderer, BackgroundIsNoBody) {
  SceneSpec spec;
  spec.world.background = {0.5, 0.25, 0.75};
  const auto scene = Scene::Build(spec);
  ASSERT_TRUE(scene) << scene.error().message;
  World world(*scene);
  auto renderer = Renderer::Open(*scene);
  ASSERT_TRUE(renderer) << renderer.error().message;
  Picture picture = Blank((*scene)->camera());
  renderer->Render(world, picture);
  EXPECT_NEAR(picture[0], 128, 2);  // the top row is behind the table
  EXPECT_NEAR(picture[1], 64, 2);
  EXPECT_NEAR(picture[2], 191, 2);
  auto ids = Segment(*renderer, world);
  EXPECT_EQ(ids[0], -1);
  const Picture before = picture;
  renderer->Render(world, picture);
  EXPECT_EQ(picture, before);
}

double MeanDifference(const Picture& a, const Picture& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(int{a[i]} - int{b[i]});
  return sum / static_cast<double>(a.size());
}

Picture PictureOf(const SceneSpec& spec) {
  const auto scene = Scene::Build(spec).value();
  World world(scene);
  Renderer renderer = Renderer::Open(scene).value();
  return Take(renderer, world);
}

// What is drawn had room for 512 shapes once: of a robot with more, the last ones were missing without a word.
TEST(Renderer, DrawsAllOfARobotWithManyVisualShapes) {
  SketchRobot few, many;
  std::string hidden;
  for (int k = 0; k < 600; ++k) hidden += R"(<geom class="look" type="sphere" size="0.001" pos="0 0 0.085"/>)";
  const std::string turret = R"(<joint name="turn" axis="0 0 1" range="-170 170"/>)";
  many.InMjcf(turret, turret + hidden);
  SceneSpec spec;
  spec.robot = few.yaml();
  const Picture picture = PictureOf(spec);
  spec.robot = many.yaml();
  EXPECT_EQ(PictureOf(spec), picture) << "they lie inside the turret";
}

// The nominal scene, moved without another compiled one.
CameraSpec Elsewhere() {
  CameraSpec camera;
  camera.position = {0.3, 1.3, 1.2};
  camera.euler = {-0.85, 0.15, 3.0};
  camera.fovy_deg = 50;
  return camera;
}

TEST(Renderer, AMovedCameraTakesThePictureOfASceneThatHasItThere) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  EXPECT_EQ(renderer.camera().X_WC.p, FullScene()->camera().X_WC.p);
  SceneSpec spec;
  spec.camera = Elsewhere();
  const Picture there = PictureOf(spec);
  renderer.SetCamera(ToCamera(spec.camera));
  EXPECT_LT(MeanDifference(Take(renderer, world), there), 0.1);
  EXPECT_GT(MeanDifference(normal, there), 5);
  EXPECT_EQ(renderer.camera().fovy, ToCamera(spec.camera).fovy);

  // its segmentation and its depth are of the same place
  auto ids = Segment(renderer, world);
  for (const char* name : {"cube", "coke", "pepsi"}) {
    const Eigen::Vector2d seen = Centroid(ids, 224, world.BodyId(name));
    EXPECT_LT((seen - renderer.camera().Project(world.ObjectPose(name).p)).norm(), 4) << name;
  }
  std::vector<float> depth(224 * 224);
  renderer.RenderDepth(world, depth);
  const Eigen::Vector3d on_table(0.1, 0.5, 0);
  const Eigen::Vector2d pixel = renderer.camera().Project(on_table);
  EXPECT_NEAR(depth[static_cast<std::size_t>(pixel.y()) * 224 + static_cast<std::size_t>(pixel.x())],
              -(renderer.camera().X_WC.inverse() * on_table).z(), 0.015);

  renderer.SetCamera(std::nullopt);
  EXPECT_EQ(Take(renderer, world), normal);
}

// Pictures of one compiled scene in several appearances.
struct AppearanceRig {
  explicit AppearanceRig(const SceneSpec& spec)
      : scene(Scene::Build(spec).value()), world(scene), renderer(Renderer::Open(scene).value()) {}
  Picture operator()(const Appearance& appearance) {
    renderer.SetAppearance(appearance);
    return Take(renderer, world);
  }

  std::shared_ptr<const Scene> scene;
  World world;
  Renderer renderer;
};

TEST(Renderer, AnotherTableIsThatOfASceneThatHasIt) {
  SceneSpec spec;
  spec.tables = {"wood", "stone"};
  AppearanceRig take(spec);
  SceneSpec stone;
  stone.world.table = "stone";
  const Picture wood = take({});
  EXPECT_EQ(wood, PictureOf(SceneSpec())) << "more tables compiled in change nothing";
  EXPECT_EQ(take({.table = "stone"}), PictureOf(stone));
  EXPECT_EQ(take({.table = "wood"}), wood);
  const Picture large = take({.table_scale = 3});
  EXPECT_GT(MeanDifference(large, wood), 0.5);
  const Picture red = take({.table_colour = {1, 0.5, 0.5}});
  EXPECT_LT(Mean(red), 0.9 * Mean(wood));
  EXPECT_EQ(take({}), wood);
}

TEST(Renderer, AnotherBackgroundIsThatOfASceneThatHasIt) {
  SceneSpec spec, blue;
  spec.backdrop = true;
  AppearanceRig take(spec);
  const Picture black = take({});
  EXPECT_EQ(black, PictureOf(SceneSpec()));
  blue.world.background = {0.2, 0.4, 0.6};
  EXPECT_EQ(take({.background = Eigen::Vector3d(0.2, 0.4, 0.6)}), PictureOf(blue));
  const Picture first = take({.background = Eigen::Vector3d(0.9, 0, 0)});
  EXPECT_NEAR(first[0], 230, 1);
  EXPECT_EQ(take({}), black);
}

TEST(Renderer, AWorldDressesItsObjectsAndNothingElse) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  auto ids = Segment(renderer, world);
  renderer.SetAppearance(WithWorld({}, EpisodeWorld{}, *FullScene()));
  EXPECT_EQ(Take(renderer, world), normal);
  for (const EpisodeWorld& drawn : {EpisodeWorld{.colour = {{"milk", {0.5, 1, 1}}}, .gloss = {}},
                                    EpisodeWorld{.colour = {}, .gloss = {{"milk", 0.8}}}}) {
    renderer.SetAppearance(WithWorld({}, drawn, *FullScene()));
    const Picture dressed = Take(renderer, world);
    int changed = 0;
    for (std::size_t i = 0; i < dressed.size(); ++i) {
      if (dressed[i] == normal[i]) continue;
      ++changed;
      EXPECT_EQ(ids[i / 3], world.BodyId("milk"));
    }
    EXPECT_GT(changed, 20);
  }
}

TEST(Renderer, ASunThatShinesFromElsewhereIsThatOfASceneThatHasIt) {
  World world(FullScene());
  Renderer renderer = OpenOrDie();
  const Picture normal = Take(renderer, world);
  SceneSpec spec;
  const Eigen::Vector3d sun = Eigen::Vector3d(-0.10, -0.45, -1).normalized(), shift(0.4, 0.3, 0.1);
  spec.world.light_direction = {sun.x() + shift.x(), sun.y() + shift.y(), sun.z() + shift.z()};
  renderer.SetAppearance(WithWorld({}, EpisodeWorld{.sun_shift = {0.4, 0.3, 0.1}}, *FullScene()));
  EXPECT_LT(MeanDifference(Take(renderer, world), PictureOf(spec)), 0.05);
  EXPECT_GT(MeanDifference(normal, PictureOf(spec)), 0.3);
}

TEST(Renderer, RefusesUnknownBackend) {
  const auto renderer = Renderer::Open(FullScene(), {.backend = "vulkan"});
  ASSERT_FALSE(renderer);
  EXPECT_EQ(renderer.error().code, Code::kInvalidArgument);
  EXPECT_THAT(renderer.error().message, testing::HasSubstr("osmesa"));
}

TEST(Renderer, KnowsWhoDrawsOnTheCpu) {
  for (const char* name : {"llvmpipe (LLVM 15.0.6, 256 bits)", "softpipe", "SWR (LLVM 11.0.1, 256 bits)",
                           "Software Rasterizer", "zink (llvmpipe (LLVM 15.0.6, 256 bits))"})
    EXPECT_TRUE(IsSoftwareRenderer(name)) << name;
  for (const char* name : {"NVIDIA H100 PCIe/PCIe/SSE2", "AMD Radeon RX 6800 (navi21, LLVM 15.0.6)",
                           "Mesa Intel(R) UHD Graphics 630 (CFL GT2)", "zink (NVIDIA GeForce RTX 3090)"})
    EXPECT_FALSE(IsSoftwareRenderer(name)) << name;
}

// Whatever GPU this machine has.
TEST(Renderer, DrawsInSoftwareUnlessAGpuIsAskedFor) {
  EXPECT_TRUE(IsSoftwareRenderer(OpenOrDie().gl_renderer())) << OpenOrDie().gl_renderer();
}

TEST(Renderer, WhereNoGpuDrawsTheErrorSaysWhichDevicesThereAre) {
  const auto renderer = Renderer::Open(FullScene(), {.renderer = "gpu"});
  if (renderer) {
    EXPECT_FALSE(IsSoftwareRenderer(renderer->gl_renderer())) << renderer->gl_renderer();
    GTEST_SKIP() << "a GPU draws here: " << renderer->gl_renderer();
  }
  EXPECT_EQ(renderer.error().code, Code::kUnavailable);
  EXPECT_THAT(renderer.error().message, testing::HasSubstr("renderer gpu: no GPU draws here: "));
  EXPECT_THAT(renderer.error().message, testing::HasSubstr("renderer: software"));
}

TEST(Renderer, AGpuIsTakenByItsNumberOrNoneIs) {
  const auto renderer = Renderer::Open(FullScene(), {.renderer = "gpu", .device = 63});
  ASSERT_FALSE(renderer);
  EXPECT_EQ(renderer.error().code, Code::kUnavailable);
  EXPECT_THAT(renderer.error().message,
              testing::AllOf(testing::HasSubstr("renderer gpu, device 63: no GPU draws here: "),
                             testing::HasSubstr("there is no device 63. EGL lists:\n")));
  const auto first = Renderer::Open(FullScene(), {.renderer = "gpu", .device = 0});
  if (renderer.error().message.find("device 0: Mesa's software renderer") == std::string::npos) return;
  ASSERT_FALSE(first);
  EXPECT_THAT(first.error().message, testing::HasSubstr("device 0 is no GPU. EGL lists:\n"));
}

TEST(Renderer, AGpuThatWasRefusedChangesNoPicture) {
  World world(FullScene());
  Picture before;
  {
    Renderer renderer = OpenOrDie();
    before = Take(renderer, world);
  }
  (void)Renderer::Open(FullScene(), {.renderer = "gpu"});
  Renderer renderer = OpenOrDie();
  EXPECT_EQ(Take(renderer, world), before);
}

TEST(Renderer, RefusesRenderersThatCannotBe) {
  const auto unknown = Renderer::Open(FullScene(), {.renderer = "cuda"});
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, Code::kInvalidArgument);
  EXPECT_THAT(unknown.error().message, testing::HasSubstr("renderer 'cuda' is not known; known: software, gpu"));
  const auto contradiction = Renderer::Open(FullScene(), {.backend = "osmesa", .renderer = "gpu"});
  ASSERT_FALSE(contradiction);
  EXPECT_EQ(contradiction.error().code, Code::kInvalidArgument);
  EXPECT_THAT(contradiction.error().message, testing::HasSubstr("osmesa draws on the CPU"));
}

TEST(Renderer, ASpecSaysWhoDraws) {
  CampaignSpec spec;
  spec.renderer = "gpu";
  spec.device = 2;
  const RendererConfig config = RendererFor(spec, {.samples = 4});
  EXPECT_EQ(config.renderer, "gpu");
  EXPECT_EQ(config.device, 2);
  EXPECT_EQ(config.samples, 4);
  EXPECT_EQ(RendererFor(CampaignSpec(), config).renderer, "software");
}

}  // namespace renderer_test
}  // namespace etude::sim
