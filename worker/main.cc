// SPDX-License-Identifier: Apache-2.0
// etude-worker: joins a campaign and makes its episodes (work.h). Here are its command line and the commands that are
// only a few calls.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "services/campaign/fingerprint.h"
#include "services/campaign/spec_file.h"
#include "services/core/clock.h"
#include "services/core/command.h"
#include "services/core/command_table.h"
#include "services/core/config_reference.h"
#include "services/core/log.h"
#include "services/core/pinned_process.h"
#include "services/spec/content_version.h"
#include "services/spec/episode_plan.h"
#include "services/store/dataset.h"
#include "services/store/sampling_journal.h"
#include "worker/fingerprint.h"
#include "worker/play.h"
#include "worker/sim/renderer.h"
#include "worker/sim/robot_file.h"
#include "worker/task/outcome_meaning.h"
#include "worker/task/verdict.h"
#include "worker/view/replay.h"
#include "worker/view/robot_check.h"
#include "worker/view/scene_picture.h"
#include "worker/view/task_check.h"
#include "worker/work.h"

namespace etude {
namespace {

struct Arguments {
  WorkArguments work;
  campaign::SpecArguments scene_spec;
  ScenePictureOptions scene;
  std::string picture = "scene.png";
  std::string robot;
  ReplayOptions replay;
  std::string task;
  TaskCheckOptions task_check;
  RobotCheckOptions robot_check;
  PlayOptions play;
  bool child = false;  ///< of a host with slots
  bool fingerprint = false, json = false;
};

// Renders one picture and says with what.
Status Doctor(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto scene, sim::Scene::Build(SceneSpec{}));
  ETUDE_ASSIGN_OR_RETURN(auto renderer, sim::Renderer::Open(scene, arguments.work.renderer));
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

Status PrintFingerprint(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const campaign::Fingerprint fingerprint, TakeFingerprint(arguments.work.renderer));
  if (arguments.json) {
    OrderedJson json = OrderedJson::object();
    for (const auto& [name, value] : fingerprint) json[name] = value;
    fmt::print("{}\n", json.dump());
    return {};
  }
  for (const auto& [name, value] : fingerprint) fmt::print("{:<10} {}\n", name, value);
  fmt::print("{:<10} {}\n", "in short", campaign::ShortHash(fingerprint));
  return {};
}

Status RenderScene(const Arguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(arguments.scene_spec));
  return WriteScenePictures(spec, arguments.picture, arguments.scene, arguments.work.renderer);
}

void AddOverrides(CLI::App& command, Arguments& arguments, const std::string& example) {
  command.add_option("--set", arguments.scene_spec.overrides, "KEY=VALUE over the file's, e.g. " + example)
      ->allow_extra_args(false)
      ->type_name("KEY=VALUE");
}

CLI::App* AddRender(CLI::App& app, Arguments& arguments) {
  auto* scene = app.add_subcommand("scene", "look at a campaign's scenes")->require_subcommand(1);
  auto* render = scene->add_subcommand("render", "the first picture of episodes, as the camera sees it");
  render->add_option("spec", arguments.scene_spec.file, "campaign file")->required();
  render->add_option("--index", arguments.scene.indices, "episode; several come side by side")->capture_default_str();
  render->add_option("--attempt", arguments.scene.attempt, "attempt at it")->capture_default_str();
  render->add_option("--seed", arguments.scene_spec.seed, "instead of the file's");
  AddOverrides(*render, arguments, "camera.width=640");
  render->add_option("--out", arguments.picture, "picture, .png or .jpg")
      ->check(EndsWith({".png", ".jpg"}))
      ->capture_default_str();
  render->add_flag("--segmentation", arguments.scene.segmentation, "also one with a colour for each body");
  render->add_flag("--depth", arguments.scene.depth, "also one of depth: 16 bits, mm");
  return render;
}

// An episode of another spec, which a merge has numbered anew or an import brought, is no attempt of this one.
Status CheckMadeHere(const Episode& episode, const CampaignSpec& spec, const std::string& dataset) {
  if (episode.seed == EpisodeSeed(spec, episode.index, episode.attempt)) return {};
  const auto from = episode.details.find("merged_from");
  return Fail(Code::kInvalidArgument,
              fmt::format("replay episode {} of '{}': {}", episode.index, dataset,
                          from != episode.details.end()
                              ? fmt::format("it was merged; replay it where it was made: {}", JsonText(*from))
                              : "it was imported, and not made by this dataset's spec"));
}

// Of a campaign file, or of a dataset, whose failed attempts are then the ones its attempts.jsonl tells of, and whose
// sampling journal says what was asked for.
Status Replay(const Arguments& arguments) {
  const campaign::SpecArguments& asked = arguments.scene_spec;
  std::error_code error;
  if (!std::filesystem::is_directory(asked.file, error)) {
    ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::LoadSpec(asked));
    return ReplayAttempt(spec, arguments.replay, arguments.work.renderer);
  }
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(asked.file));
  if (reader.content_version() != kContentVersion || reader.spec_sha256() != SpecHash(reader.spec()))
    Log().warn(
        "dataset '{}' was made by another version (content {}, here {}): what this one makes of its spec need "
        "not be the attempt that happened there",
        asked.file, reader.content_version(), kContentVersion);
  if (const auto there = reader.Read(arguments.replay.index))
    ETUDE_RETURN_IF_ERROR(CheckMadeHere(there->episode, reader.spec(), asked.file));
  ETUDE_ASSIGN_OR_RETURN(const auto journal, store::SamplingJournal::Open(asked.file, reader.spec()));
  ETUDE_ASSIGN_OR_RETURN(const CampaignSpec spec, campaign::WithOverrides(reader.spec(), asked.overrides));
  ReplayOptions replay = arguments.replay;
  if (const SamplingEntry* entry = journal.EntryAt(replay.index)) replay.sampling = *entry;
  return ReplayAttempt(spec, replay, arguments.work.renderer);
}

CLI::App* AddReplay(CLI::App& app, Arguments& arguments) {
  auto* attempt = app.add_subcommand("attempt", "make an attempt again")->require_subcommand(1);
  auto* replay = attempt->add_subcommand("replay", "an attempt, failed or not, with all that is known of it");
  replay->add_option("spec", arguments.scene_spec.file, "campaign file, or the folder of a dataset")->required();
  replay->add_option("--index", arguments.replay.index, "episode")->required();
  replay->add_option("--attempt", arguments.replay.attempt, "attempt at it")->capture_default_str();
  replay->add_option("--out", arguments.replay.out, "folder, new or empty")->required()->check(NamesAPlace());
  AddOverrides(*replay, arguments, "image_stride=2");
  return replay;
}

CLI::App* AddRobotCheck(CLI::App& robot, Arguments& arguments) {
  auto* check = robot.add_subcommand("check", "whether a robot can collect, and what is missing");
  check->add_option("robot", arguments.robot, "its YAML file (see deploy/robots), or the name of a known one")
      ->required();
  check->add_flag("--json", arguments.robot_check.as_json, "as one JSON object, at the end");
  return check;
}

Status DescribeRobotFile(bool as_json) {
  PrintReference(ConfigReference<sim::RobotFile>(), as_json);
  return {};
}

// What `reason` in attempts.jsonl, in telemetry and in evaluations may be.
Status DescribeOutcomes(bool as_json) {
  OrderedJson list = OrderedJson::array();
  for (const auto outcome : task::kAttemptOutcomes)
    list.push_back({{"outcome", task::ToString(outcome)}, {"meaning", task::Meaning(outcome)}});
  if (as_json) return fmt::print("{}\n", list.dump(1)), Status();
  for (const auto outcome : task::kAttemptOutcomes)
    fmt::print("{:<18} {}\n", task::ToString(outcome), task::Meaning(outcome));
  return {};
}

CLI::App* AddTaskCheck(CLI::App& app, Arguments& arguments) {
  auto* task = app.add_subcommand("task", "tasks of your own")->require_subcommand(1);
  auto* check = task->add_subcommand("check", "what a task means, on which robots it works, and what is wrong with it");
  check->add_option("task", arguments.task, "its YAML file (see deploy/tasks), or the name of a built-in one")
      ->required();
  check->add_option("--robots", arguments.task_check.robots, "to try it with: names or files")
      ->delimiter(',')
      ->capture_default_str();
  check->add_option("--attempts", arguments.task_check.attempts, "demonstrations with each")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  check->add_flag("--json", arguments.task_check.as_json, "as one JSON object, at the end");
  return check;
}

void AddJoining(CLI::App& app, Arguments& arguments) {
  app.add_option("--campaign", arguments.work.worker.campaign, "campaign to join: NAME, or NAME@ID of one of several");
  arguments.work.bus.Add(app);
  app.add_option("--name", arguments.work.worker.name, "unique name on the bus");
  app.add_flag("--once", arguments.work.worker.once, "one attempt, then home");
  app.add_option_function<double>(
         "--idle-timeout",
         [&](double seconds) {
           arguments.work.worker.idle_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * seconds));
         },
         "seconds without work, then home (default: waits for ever)")
      ->check(CLI::Range(0.1, 1e6));
  app.add_option("--gl", arguments.work.renderer.backend, "auto | egl | osmesa")
      ->check(CLI::IsMember({"auto", "egl", "osmesa"}))
      ->capture_default_str();
  app.add_option("--renderer", arguments.work.renderer.renderer,
                 "software | gpu: with --fingerprint and doctor; a campaign says its own")
      ->check(CLI::IsMember({"software", "gpu"}))
      ->capture_default_str();
  app.add_option("--device", arguments.work.renderer.device, "with --renderer gpu: its number in EGL's list; -1: any")
      ->check(CLI::Range(-1, 63))
      ->capture_default_str();
  app.add_option("--slots", arguments.work.slots,
                 "makes so many episodes at a time, each in a supervised child; one participant on the bus for all "
                 "(default: one a core). 0: one at a time, in this process, as `etude collect` has its own supervision")
      ->check(CLI::Range(0, 1024));
  app.add_option("--stall-timeout", arguments.work.stall_s,
                 "with --slots: seconds without a word of a child that works, after which it is replaced; at least "
                 "nine tenths of the campaign's stall_timeout_s")
      ->check(CLI::Range(1.0, 86'400.0))
      ->capture_default_str();
  auto* fingerprint = app.add_flag("--fingerprint", arguments.fingerprint,
                                   "prints what the bytes of this machine's episodes depend on, and ends");
  app.add_flag("--json", arguments.json, "the fingerprint as JSON")->needs(fingerprint);
  app.add_flag("--child", arguments.child)->group("");  // hidden: how a host starts its children
}

// Who joins a campaign is told by it who draws; one attempt needs no slots.
void CheckJoining(const CLI::App& app, Arguments& arguments) {
  if (!app.get_subcommands().empty() || arguments.child || arguments.fingerprint) return;
  if (arguments.work.worker.campaign.empty()) throw CLI::RequiredError("--campaign");
  if (arguments.work.worker.once && app.count("--slots") == 0) arguments.work.slots = 0;
  if (app.count("--renderer") + app.count("--device") > 0)
    throw CLI::ExcludesError("--campaign", "--renderer, --device");
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  etude::PinProcess(argv);
  // llvmpipe is fastest without threads of its own when every core has a worker
  ::setenv("LP_NUM_THREADS", "0", 0);
  // here, while there is one thread; a campaign with renderer: gpu takes it back (worker/sim/gl_context.cc)
  ::setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
  etude::Arguments arguments;
  CLI::App app("Joins a campaign and makes episodes until it is complete.", "etude worker");
  etude::AddJoining(app, arguments);
  auto* doctor = app.add_subcommand("doctor", "render one picture and say with what");
  auto* render = etude::AddRender(app, arguments);
  auto* robot = app.add_subcommand("robot", "robots of your own")->require_subcommand(1);
  auto* check = etude::AddRobotCheck(*robot, arguments);
  auto* describe =
      robot->add_subcommand("describe", "every key of a robot file with its type, unit, default and meaning");
  bool as_json = false;
  describe->add_flag("--json", as_json, "as JSON");
  auto* outcomes = app.add_subcommand("outcomes", "how an attempt may end, and what each means");
  outcomes->add_flag("--json", as_json, "as JSON");
  auto* replay = etude::AddReplay(app, arguments);
  auto* task_check = etude::AddTaskCheck(app, arguments);
  auto* play = etude::AddPlay(app, arguments.play);
  play->fallthrough();  // --domain, --gl
  app.require_subcommand(0, 1);
  app.callback([&] { etude::CheckJoining(app, arguments); });
  if (const auto ended = etude::ParseCommandLine(app, argc, argv)) return *ended;
  return etude::RunMain("etude-worker", [&] {
    if (arguments.child) return etude::BeChild(arguments.work);
    if (arguments.fingerprint) return etude::PrintFingerprint(arguments);
    if (*doctor) return etude::Doctor(arguments);
    if (*describe) return etude::DescribeRobotFile(as_json);
    if (*outcomes) return etude::DescribeOutcomes(as_json);
    if (*replay) return etude::Replay(arguments);
    if (*check) return etude::CheckRobot(arguments.robot, arguments.work.renderer, arguments.robot_check);
    if (*task_check) return etude::CheckTaskFile(arguments.task, arguments.task_check, arguments.work.renderer);
    if (*play) return etude::Play(arguments.play, arguments.work.bus, arguments.work.renderer);
    if (*render) return etude::RenderScene(arguments);
    return arguments.work.slots > 0 ? etude::Host(arguments.work) : etude::Work(arguments.work);
  });
}
