// SPDX-License-Identifier: Apache-2.0
// Tests trainer/serve/model.cc
#include "trainer/serve/model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <thread>

#include "services/core/hash.h"
#include "services/episode/action.h"
#include "tests/support/temporary_folder.h"
#include "tests/trainer/policy/clip/clip_policy.h"
#include "tests/trainer/policy/fixtures.h"
#include "tests/trainer/serve/example_observation.h"

namespace etude::serve {
namespace model_test {

using ::testing::HasSubstr;

class ModelTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    bytes_ = checkpoint::Encode(checkpoint::ExampleCheckpoint(config_)).value();
    auto model = Model::FromBytes(bytes_);
    ASSERT_TRUE(model) << model.error().message;
    model_ = *model;
  }
  policy::PolicyConfig config_ = policy::TinyConfig();
  std::vector<std::uint8_t> bytes_;
  std::shared_ptr<const Model> model_;
};

TEST_F(ModelTest, AnswersWithWaypointsAndEveryModulesOutput) {
  const auto action = model_->Answer(ExampleObservation(3));

  EXPECT_EQ(action.error, "");
  EXPECT_EQ(action.session, "client-3");
  EXPECT_EQ(action.request_id, 4u);
  EXPECT_EQ(action.checkpoint_step, 100u);
  EXPECT_EQ(action.checkpoint_sha256, Sha256Hex(bytes_));
  ASSERT_EQ(action.waypoints.size(), static_cast<std::size_t>(kWaypoints * kWaypointSize));
  for (int k = 0; k < kWaypoints; ++k) {
    EXPECT_GE(action.waypoints[static_cast<std::size_t>(k * kWaypointSize + 9)], 0);
    EXPECT_LE(action.waypoints[static_cast<std::size_t>(k * kWaypointSize + 9)], 1);
  }
  const auto modules = OrderedJson::parse(action.modules_json);
  EXPECT_THAT(config_.objects, ::testing::Contains(modules["LANG"]["value"].get<std::string>()));
  EXPECT_EQ(modules["TAR2D"]["value"].size(), 2u);
  EXPECT_EQ(modules["TAR2D"]["soft_argmax"].size(), 2u);
  const auto expect = [&](const char* name, const char* entity, const char* quantity, std::size_t numbers) {
    const OrderedJson& module = modules[name];
    EXPECT_EQ(module["entity"], entity) << name;
    EXPECT_EQ(module["quantity"], quantity) << name;
    EXPECT_EQ(module["unit"], "m") << name;
    EXPECT_EQ(module["value"].size(), numbers) << name;
  };
  expect("EE3D", "ee", "pose", 9);
  expect("TAR3D", "target", "position", 3);
  expect("DISP", "target", "displacement", 3);
}

// float32 sums in another order there
TEST_F(ModelTest, AnswersAndLooksInsideOnCudaAsOnTheCpu) {
  if (!torch::cuda::is_available()) GTEST_SKIP() << "no CUDA device";
  const auto made = Model::FromBytes(bytes_, nullptr, torch::Device(torch::kCUDA));
  ASSERT_TRUE(made) << made.error().message;
  const auto observation = ExampleObservation(3);
  const auto there = (*made)->Answer(observation), here = model_->Answer(observation);
  EXPECT_EQ(there.error, "");
  ASSERT_EQ(there.waypoints.size(), here.waypoints.size());
  for (std::size_t i = 0; i < here.waypoints.size(); ++i)
    EXPECT_NEAR(there.waypoints[i], here.waypoints[i], 1e-3 * (1 + std::abs(here.waypoints[i]))) << i;
  EXPECT_EQ((*made)->Inspect(observation, R"({"worth": true})").error, "");
}

TEST_F(ModelTest, IsToldTheCameraWhereAModuleReadsIt) {
  auto& decoder = policy::FindModule(config_, "TAR3D")->decoder;
  decoder.readout = "ray";
  decoder.from = {"TAR2D"};
  auto example = checkpoint::ExampleCheckpoint(config_);
  example.metadata.embodiment.fovy = 0;  // it moved while training
  example.metadata.embodiment.camera_pose.clear();
  const auto made = Model::FromBytes(checkpoint::Encode(example).value());
  ASSERT_TRUE(made) << made.error().message;
  const Model& model = **made;
  EXPECT_EQ(model.Answer(model.Trial()).error, "");

  auto observation = ExampleObservation(3);
  EXPECT_THAT(model.Answer(observation).error, HasSubstr("does not say its camera"));
  observation.intrinsics = {40, 40, 24, 24};
  observation.camera_pose = {0, 0, 1, 1, 0, 0, 0};
  const auto here = model.Answer(observation);
  EXPECT_EQ(here.error, "");
  observation.camera_pose[0] = 0.1;
  const auto there = model.Answer(observation);
  const auto place = [](const bus::Action& action) {
    return OrderedJson::parse(action.modules_json)["TAR3D"]["value"][0].get<double>();
  };
  EXPECT_NEAR(place(there) - place(here), 0.1, 1e-4) << "the same picture from a camera ten centimetres aside";
  EXPECT_EQ(model.Inspect(observation, R"({"worth": true})").error, "");

  observation.intrinsics[0] = 0;
  EXPECT_THAT(model.Answer(observation).error, HasSubstr("no camera has"));
}

TEST_F(ModelTest, RefusesObservationsThatDoNotFit) {
  const auto error = [&](auto change) {
    auto observation = ExampleObservation(3);
    change(observation);
    const auto action = model_->Answer(observation);
    EXPECT_TRUE(action.waypoints.empty());
    return action.error;
  };
  EXPECT_THAT(error([](auto& o) { o.image.pop_back(); }), HasSubstr("bytes"));
  EXPECT_THAT(error([](auto& o) { o.joints.push_back(0); }), HasSubstr("joints: 8 here, 7 there"));
  EXPECT_THAT(error([](auto& o) { o.joints[2] = std::numeric_limits<float>::quiet_NaN(); }), HasSubstr("finite"));
  EXPECT_THAT(error([](auto& o) {
                o.width = o.height = 20;
                o.image.resize(20 * 20 * 3);
              }),
              HasSubstr("camera width: 20 here, 48 there"));
  EXPECT_THAT(error([](auto& o) { o.robot = "panda"; }), HasSubstr("robot: panda here, ur5 there"));
  EXPECT_THAT(error([](auto& o) { o.intrinsics = {20, 20, 24, 24}; }), HasSubstr("camera fovy"));
  // a camera of another make: the middle of the picture is elsewhere, or its pixels are no squares
  EXPECT_THAT(error([](auto& o) { o.intrinsics = {43.93171, 43.93171, 20, 24}; }), HasSubstr("centre (20, 24) here"));
  EXPECT_THAT(error([](auto& o) { o.intrinsics = {50, 43.93171, 24, 24}; }), HasSubstr("fx 50, fy 43.93"));
  EXPECT_THAT(error([](auto& o) { o.camera_pose = {1.5, 0, 0.8, 1, 0, 0, 0}; }), HasSubstr("camera pose"));
  EXPECT_THAT(error([](auto& o) { o.width = 0xffffffffu; }), HasSubstr("bytes"));
}

// its numbers would be followed, and mean another motion
TEST_F(ModelTest, RefusesToAnswerForAnotherRateHorizonOrFormat) {
  const auto error = [&](auto change) {
    auto other = checkpoint::ExampleCheckpoint(config_);
    change(other.metadata.embodiment);
    const auto model = Model::FromBytes(checkpoint::Encode(other).value());
    EXPECT_TRUE(model);
    const auto action = (*model)->Answer(ExampleObservation(3));
    EXPECT_TRUE(action.waypoints.empty());
    EXPECT_EQ(action.refusal, action.error.empty() ? bus::Refusal::kNone : bus::Refusal::kDoesNotFit);
    return action.error;
  };
  EXPECT_THAT(error([](auto& e) { e.control_rate = 100; }), HasSubstr("control rate: 125 here, 100 there"));
  EXPECT_THAT(error([](auto& e) { e.horizon = 60; }), HasSubstr("horizon: 120 here, 60 there"));
  EXPECT_THAT(error([](auto& e) { e.waypoints = 10; }), HasSubstr("waypoints: 12 here, 10 there"));
  EXPECT_THAT(error([](auto& e) { e.rotation = "quaternion"; }), HasSubstr("rotation format: 6d here, quaternion"));
}

TEST_F(ModelTest, TakesPicturesOfAnyCameraWhenItLearnedFromOneThatMoves) {
  auto moving = checkpoint::ExampleCheckpoint(config_);
  moving.metadata.embodiment.fovy = 0;
  moving.metadata.embodiment.camera_pose.clear();
  const auto model = Model::FromBytes(checkpoint::Encode(moving).value());
  ASSERT_TRUE(model) << model.error().message;
  auto observation = ExampleObservation(3);
  observation.intrinsics = {20, 20, 24, 24};
  observation.camera_pose = {1.5, 0, 0.8, 1, 0, 0, 0};
  const auto action = (*model)->Answer(observation);
  EXPECT_EQ(action.error, "");
  EXPECT_FALSE(action.waypoints.empty());
}

TEST_F(ModelTest, TakesPicturesOfAnyCameraWhereThatIsAskedFor) {
  const auto bytes = checkpoint::Encode(checkpoint::ExampleCheckpoint(config_)).value();
  const auto model = Model::FromBytes(bytes, nullptr, torch::kCPU, Cameras::kAny);
  ASSERT_TRUE(model) << model.error().message;
  auto observation = ExampleObservation(3);
  observation.intrinsics = {20, 20, 24, 24};
  EXPECT_EQ((*model)->Answer(observation).error, "");
  observation.robot = "panda";
  EXPECT_THAT((*model)->Answer(observation).error, HasSubstr("robot: panda here")) << "the robot is not another one";
}

// before, a checkpoint of an early stage drove the robot with the random numbers of a module that nobody had trained
TEST_F(ModelTest, RefusesWhileAModuleOnTheControlPathIsUntrained) {
  auto early = checkpoint::ExampleCheckpoint(config_);
  early.metadata.modules["CTRL"] = {};
  const auto model = Model::FromBytes(checkpoint::Encode(early).value());
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_EQ((*model)->untrained(), "CTRL has 0 trained steps");

  const auto action = (*model)->Answer(ExampleObservation(3));

  EXPECT_THAT(action.error, HasSubstr("CTRL has 0 trained steps"));
  EXPECT_EQ(action.refusal, bus::Refusal::kNotTrained);
  EXPECT_TRUE(action.waypoints.empty());
  EXPECT_EQ(action.checkpoint_step, 100u);
}

TEST_F(ModelTest, AnswersAnySentence) {
  auto observation = ExampleObservation(3);
  for (const char* sentence : {"", "?!", "\xff\xfe", "grab teh coek"}) {
    observation.instruction = sentence;
    EXPECT_EQ(model_->Answer(observation).error, "") << sentence;
  }
}

TEST_F(ModelTest, AnswersTheSameAloneAndBesideOthers) {
  std::vector<bus::Action> alone(8), beside(8);
  for (std::size_t i = 0; i < alone.size(); ++i) alone[i] = model_->Answer(ExampleObservation(i));
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < beside.size(); ++i)
    threads.emplace_back([&, i] { beside[i] = model_->Answer(ExampleObservation(i)); });
  for (auto& thread : threads) thread.join();

  for (std::size_t i = 0; i < alone.size(); ++i) {
    EXPECT_EQ(alone[i].waypoints, beside[i].waypoints);
    EXPECT_EQ(alone[i].modules_json, beside[i].modules_json);
  }
  EXPECT_NE(alone[0].waypoints, alone[1].waypoints);
}

// the folder is needed where the policy serves, wherever it lies there, and it must hold what the policy learned from
TEST_F(ModelTest, NeedsTheFolderOfAPolicyWhoseLanguageIsClips) {
  const TemporaryFolder folder;
  clip::WriteTinyClip(folder / "here", clip::TinyModel({.layers = 1}));
  const auto bytes =
      checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::WithClip(folder / "here", config_))).value();
  const auto model = Model::FromBytes(bytes);
  ASSERT_TRUE(model) << model.error().message;
  const auto answer = (*model)->Answer(ExampleObservation(3));
  EXPECT_EQ(answer.error, "");
  EXPECT_EQ(answer.waypoints.size(), static_cast<std::size_t>(kWaypoints * kWaypointSize));

  std::filesystem::rename(folder / "here", folder / "there");
  const auto gone = Model::FromBytes(bytes);
  ASSERT_FALSE(gone);
  EXPECT_THAT(gone.error().message, HasSubstr((folder / "here").string()));
  clip::Folders there((folder / "there").string());
  const auto moved = Model::FromBytes(bytes, &there);
  ASSERT_TRUE(moved) << moved.error().message;
  EXPECT_EQ((*moved)->Answer(ExampleObservation(3)).waypoints, answer.waypoints);

  clip::WriteTinyClip(folder / "there", clip::TinyModel({.layers = 1}, 2));
  clip::Folders changed((folder / "there").string());
  const auto refused = Model::FromBytes(bytes, &changed);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("etude policy --clip DIR"));
  // what is open serves on, another checkpoint of the run too
  EXPECT_TRUE(Model::FromBytes(bytes, &there));
}

TEST_F(ModelTest, RefusesASentenceThatClipCannotRead) {
  const TemporaryFolder folder;
  clip::WriteTinyClip(folder / "clip", clip::TinyModel({.layers = 1}));
  const auto model = Model::FromBytes(
      checkpoint::Encode(checkpoint::ExampleCheckpoint(policy::WithClip(folder / "clip", config_))).value());
  ASSERT_TRUE(model) << model.error().message;
  auto observation = ExampleObservation(3);
  observation.instruction = std::string(80, '!');
  const auto action = (*model)->Answer(observation);
  EXPECT_THAT(action.error, HasSubstr("82 tokens with its start and end, CLIP reads up to 77"));
  EXPECT_EQ(action.refusal, bus::Refusal::kDoesNotFit);
  EXPECT_TRUE(action.waypoints.empty());
  EXPECT_THAT((*model)->Inspect(observation, "").error, HasSubstr("82 tokens"));

  observation.instruction = "pick the cup";
  EXPECT_EQ((*model)->Answer(observation).error, "");
  EXPECT_EQ((*model)->Inspect(observation, R"({"sentence": "put it down"})").error, "");
  const std::string what_if = OrderedJson{{"sentence", std::string(80, '!')}}.dump();
  EXPECT_THAT((*model)->Inspect(observation, what_if).error, HasSubstr("82 tokens"));
}

TEST_F(ModelTest, SaysThatAFileIsMissing) { EXPECT_EQ(Model::FromFile("/nonexistent").error().code, Code::kNotFound); }

}  // namespace model_test
}  // namespace etude::serve
