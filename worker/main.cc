// SPDX-License-Identifier: Apache-2.0
// etude-worker: joins a campaign and makes its episodes, with the expert or with a policy at the controls.
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <optional>

#include "services/bus/arguments.h"
#include "services/campaign/spec_file.h"
#include "services/campaign/worker_client.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"
#include "worker/policy_client.h"
#include "worker/task/attempt.h"
#include "worker/task/user_files.h"
#include "worker/view/robot_check.h"
#include "worker/view/scene_picture.h"

namespace etude {
namespace {

struct Arguments {
  campaign::WorkerOptions worker;
  bus::Arguments bus;
  sim::RendererConfig renderer;
  campaign::SpecArguments scene_spec;
  ScenePictureOptions scene;
  std::string picture = "scene.png";
  std::string robot;
};

campaign::WorkResult ResultOf(task::AttemptResult attempt, bool always_complete) {
  campaign::WorkResult result;
  result.outcome = task::ToString(attempt.outcome);
  result.steps = static_cast<std::uint64_t>(attempt.episode.steps());
  for (const auto& camera : attempt.episode.cameras) result.frames += camera.frames.size();
  if (attempt.outcome == task::AttemptOutcome::kSuccess || always_complete) {
    result.episode = EncodeEpisode(attempt.episode);
    return result;
  }
  result.details_json = OrderedJson{
      {"reason", attempt.reason},
      {"plan_s", attempt.plan_s},
      {"step_s", attempt.step_s},
      {"render_s", attempt.render_s},
      {"deflate_s",
       attempt.deflate_s}}.dump();
  return result;
}

campaign::WorkFunction Demonstrate(std::shared_ptr<task::AttemptRunner> runner) {
  return [runner](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
    return ResultOf(runner->Demonstrate(item.index, item.attempt), false);
  };
}

campaign::WorkFunction RollOut(std::shared_ptr<task::AttemptRunner> runner, std::shared_ptr<PolicyClient> policy) {
  const task::PolicyFunction ask = [policy](const task::PolicyQuestion& question) { return policy->Ask(question); };
  return [runner, ask](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
    auto attempt = runner->Rollout(item.index, ask);
    if (attempt && attempt->outcome == task::AttemptOutcome::kSceneInvalid)
      return campaign::WorkResult{.outcome = std::string(task::ToString(attempt->outcome))};
    if (attempt) return ResultOf(std::move(*attempt), true);
    // the policy did not answer: not the rollout's failure, it is tried again
    const std::string outcome = StopRequested() ? campaign::kHandedBack : campaign::kPolicyError;
    return campaign::WorkResult{.outcome = outcome,
                                .details_json = OrderedJson{{"reason", attempt.error().message}}.dump()};
  };
}

Status Work(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open());
  campaign::WorkerOptions options = arguments.worker;
  options.files_sha256 = task::UserFilesSha256;
  ETUDE_ASSIGN_OR_RETURN(auto client, campaign::WorkerClient::Open(participant, options));
  return client.Run([&](const CampaignSpec& spec) -> Result<campaign::WorkFunction> {
    ETUDE_ASSIGN_OR_RETURN(auto opened, task::AttemptRunner::Open(spec, arguments.renderer));
    auto runner = std::make_shared<task::AttemptRunner>(std::move(opened));
    Log().info("joined campaign={} mode={} worker={}", spec.name, spec.mode, client.name());
    if (spec.mode != "rollout") return Demonstrate(runner);
    ETUDE_ASSIGN_OR_RETURN(auto policy, PolicyClient::Open(participant, spec.rollout.run, client.name()));
    return RollOut(runner, std::make_shared<PolicyClient>(std::move(policy)));
  });
}

// Renders one picture and says with what.
Status Doctor(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(SceneSpec{}));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, arguments.renderer));
  sim::World world(scene);
  world.Reset();
  world.Forward();
  std::vector<std::uint8_t> rgb(static_cast<std::size_t>(scene->camera().width) * scene->camera().height * 3);
  renderer.Render(world, rgb);
  Stopwatch elapsed;
  renderer.Render(world, rgb);
  const auto [low, high] = std::minmax_element(rgb.begin(), rgb.end());
  if (*high - *low < 32)
    return Fail(Code::kUnavailable,
                fmt::format("render a picture with {}: it is blank (values {} .. {}); install libgl1-mesa-dri, or "
                            "try --gl osmesa",
                            renderer.backend(), *low, *high));
  fmt::print("{} on {}, a picture in {:.1f} ms\n", renderer.backend(), renderer.gl_renderer(), 1e3 * elapsed.Seconds());
  return {};
}

Status RenderScene(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(arguments.scene_spec));
  return WriteScenePictures(spec, arguments.picture, arguments.scene, arguments.renderer);
}

CLI::App* AddRender(CLI::App& app, Arguments& arguments) {
  auto* scene = app.add_subcommand("scene", "look at a campaign's scenes")->require_subcommand(1);
  auto* render = scene->add_subcommand("render", "the first picture of episodes, as the camera sees it");
  render->add_option("spec", arguments.scene_spec.file, "campaign file")->required();
  render->add_option("--index", arguments.scene.indices, "episode; several come side by side")->capture_default_str();
  render->add_option("--attempt", arguments.scene.attempt, "attempt at it")->capture_default_str();
  render->add_option("--seed", arguments.scene_spec.seed, "instead of the file's");
  render->add_option("--set", arguments.scene_spec.overrides, "KEY=VALUE over the file's, e.g. camera.width=640")
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
  render->add_option("--out", arguments.picture, "picture, .png or .jpg")->capture_default_str();
  render->add_flag("--segmentation", arguments.scene.segmentation, "also one with a colour for each body");
  render->add_flag("--depth", arguments.scene.depth, "also one of depth: 16 bits, mm");
  return render;
}

CLI::App* AddRobotCheck(CLI::App& app, Arguments& arguments) {
  auto* robot = app.add_subcommand("robot", "robots of your own")->require_subcommand(1);
  auto* check = robot->add_subcommand("check", "whether a robot can collect, and what is missing");
  check->add_option("robot", arguments.robot, "its YAML file (see deploy/robots), or the name of a known one")
      ->required();
  return check;
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  // llvmpipe is fastest without threads of its own when every core has a worker
  ::setenv("LP_NUM_THREADS", "0", 0);
  etude::Arguments arguments;
  CLI::App app("Joins a campaign and makes episodes until it is complete.", "etude worker");
  app.add_option("--campaign", arguments.worker.campaign, "name of the campaign to join");
  arguments.bus.Add(app);
  app.add_option("--name", arguments.worker.name, "unique name on the bus");
  app.add_flag("--once", arguments.worker.once, "one attempt, then home");
  app.add_option("--gl", arguments.renderer.backend, "auto | egl | osmesa")
      ->check(CLI::IsMember({"auto", "egl", "osmesa"}));
  auto* doctor = app.add_subcommand("doctor", "render one picture and say with what");
  auto* render = etude::AddRender(app, arguments);
  auto* check = etude::AddRobotCheck(app, arguments);
  app.require_subcommand(0, 1);
  try {
    app.parse(argc, argv);
    if (!*doctor && !*render && !*check && arguments.worker.campaign.empty()) throw CLI::RequiredError("--campaign");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? etude::kExitOk : etude::kExitUsage;
  }
  return etude::RunMain("etude-worker", [&] {
    if (*doctor) return etude::Doctor(arguments);
    if (*check) return etude::CheckRobot(arguments.robot, arguments.renderer);
    return *render ? etude::RenderScene(arguments) : etude::Work(arguments);
  });
}
