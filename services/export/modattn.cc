// SPDX-License-Identifier: Apache-2.0
#include "services/export/modattn.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "services/codec/frames.h"
#include "services/core/check.h"
#include "services/core/hash.h"
#include "services/core/stop.h"
#include "services/episode/action.h"
#include "services/episode/bounded_json.h"
#include "services/episode/codec.h"
#include "services/language/grammar.h"
#include "services/spec/episode_world.h"
#include "services/store/dataset.h"
#include "services/store/edit.h"

namespace etude::exports {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMostStates = 32 << 20;   // bytes of states.json
constexpr std::uint64_t kMostPicture = 64 << 20;  // bytes of a PNG
constexpr double kFurthest = 1000;                // m or rad: no number of theirs is larger

// When fingers count as closed: what the authors' evaluation takes for it.
struct Fingers {
  const char* robot;
  double threshold;  // rad or m of the driven finger
  bool closed_above;
};
constexpr Fingers kFingers[] = {{"ur5", 0.3, true}, {"jaco2", 1.1, false}, {"panda", 0.035, false}};

tl::unexpected<Error> Bad(std::string what) { return Fail(Code::kInvalidArgument, std::move(what)); }

Result<std::vector<double>> Numbers(const OrderedJson& json, const char* key, std::size_t least, std::size_t most) {
  const auto found = json.is_object() ? json.find(key) : json.end();
  if (!json.is_object() || found == json.end() || !found->is_array() || found->size() < least || found->size() > most)
    return Bad(fmt::format("'{}' is no list of {} to {} numbers", key, least, most));
  std::vector<double> numbers;
  for (const auto& number : *found) {
    if (!number.is_number() || !(std::abs(number.get<double>()) < kFurthest))
      return Bad(fmt::format("'{}' has what is no number, or one beyond {}", key, kFurthest));
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

Result<std::string> Word(const OrderedJson& json, const char* key) {
  const auto found = json.is_object() ? json.find(key) : json.end();
  if (!json.is_object() || found == json.end() || !found->is_string()) return Bad(fmt::format("'{}' is no text", key));
  return found->get<std::string>();
}

std::string ObjectName(const std::string& theirs) { return theirs == "target2" ? "cube" : theirs; }

Result<Pose> PoseOf(const OrderedJson& tracked) {
  ETUDE_ASSIGN_OR_RETURN(const auto xyz, Numbers(tracked, "xyz", 3, 3));
  ETUDE_ASSIGN_OR_RETURN(const auto rpy, Numbers(tracked, "rpy", 3, 3));
  return Pose{{xyz[0], xyz[1], xyz[2]}, FromEuler({rpy[0], rpy[1], rpy[2]})};
}

void Append(Track& track, std::initializer_list<double> values) {
  track.columns = static_cast<int>(values.size());
  for (const double value : values) track.values.push_back(static_cast<float>(value));
}

void Append(Track& track, const std::vector<double>& values, std::size_t begin, std::size_t end) {
  track.columns = static_cast<int>(end - begin);
  for (std::size_t i = begin; i < end; ++i) track.values.push_back(static_cast<float>(values[i]));
}

void AppendPixel(Track& track, const Camera& camera, const Eigen::Vector3d& p_W) {
  const Eigen::Vector2d pixel = camera.Project(p_W);
  Append(track, {pixel.x(), pixel.y()});
}

struct Recording {
  std::string name;  // of its folder
  Path folder;
};

// Folders with a states.json, 2 before 10.
Result<std::vector<Recording>> ListRecordings(const Path& folder) {
  std::vector<Recording> recordings;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (std::error_code ignored; fs::is_regular_file(it->path() / "states.json", ignored))
      recordings.push_back({it->path().filename().string(), it->path()});
  if (error) return Fail(ErrnoError("list", folder, error.value()));
  std::sort(recordings.begin(), recordings.end(), [](const Recording& a, const Recording& b) {
    return a.name.size() != b.name.size() ? a.name.size() < b.name.size() : a.name < b.name;
  });
  if (recordings.empty())
    return Fail(Code::kNotFound,
                fmt::format("no demonstrations in '{}': it has no folder with a states.json", folder.string()));
  return recordings;
}

// What all recordings say, before the first of them becomes an episode of a spec that is all of theirs.
struct Survey {
  std::uint64_t seed = 0;                   // two imports are not of one spec, in which a number would mean one episode
  std::vector<std::string> tasks, objects;  // in the order in which they first come
  std::size_t together = 0;                 // objects of one recording, at most
};

void AddOnce(const std::string& word, std::vector<std::string>& words) {
  if (std::ranges::find(words, word) == words.end()) words.push_back(word);
}

// Of one that cannot be read its name counts.
Survey SurveyOf(const std::vector<Recording>& recordings, const language::Grammar& grammar) {
  Survey survey;
  Sha256 hash;
  for (const Recording& recording : recordings) {
    if (StopRequested()) break;  // who imports says so
    const std::string text = ReadTextFile(recording.folder / "states.json", kMostStates).value_or("");
    hash.Update(recording.name + "\n");
    hash.Update(text);
    const OrderedJson states = ParseBoundedJson(text).value_or(OrderedJson());
    if (!states.is_array() || states.empty() || std::ssize(states) > kMaxSteps) continue;
    const OrderedJson& first = states.front();
    const auto task = Word(first, "action_inst"), goal = Word(first, "goal_object");
    if (!task || !goal || !grammar.Check(language::Command{*task, ObjectName(*goal), "", ""})) continue;
    const auto tracked = first.find("objects_to_track");
    if (tracked == first.end() || !tracked->is_object()) continue;
    std::vector<std::string> names;
    for (const auto& [theirs, state] : tracked->items())
      if (theirs != "EE") names.push_back(ObjectName(theirs));
    if (std::ranges::find(names, ObjectName(*goal)) == names.end()) continue;  // it is refused
    AddOnce(*task, survey.tasks);
    for (const auto& name : names) AddOnce(name, survey.objects);
    survey.together = std::max(survey.together, names.size());
  }
  survey.seed = etude::SeedOf(hash.Finish());
  return survey;
}

Result<OrderedJson> ReadStates(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(folder / "states.json", kMostStates));
  auto json = ParseBoundedJson(text);
  if (!json || !json->is_array() || json->empty() || std::ssize(*json) > kMaxSteps)
    return Bad(fmt::format("states.json is no list of 1 to {} steps", kMaxSteps));
  return std::move(*json);
}

// By the PNG's first chunk, before anything is allocated for what it says. Source: PNG specification, 5.2 and 11.2.2.
bool IsPngOfSaneSides(std::span<const std::uint8_t> png) {
  constexpr std::uint8_t kHead[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n', 0, 0, 0, 13, 'I', 'H', 'D', 'R'};
  if (png.size() < sizeof kHead + 8 || !std::equal(std::begin(kHead), std::end(kHead), png.begin())) return false;
  const auto side = [&](std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | png[at + i];
    return value;
  };
  const std::uint32_t width = side(16), height = side(20);
  return width >= 1 && width <= kMaxImageSide && height >= 1 && height <= kMaxImageSide;
}

// One picture, RGB and without gaps between its rows; `width` and `height` of 0 are set.
Result<cv::Mat> ReadPicture(const Path& path, int& width, int& height) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path, kMostPicture));
  if (!IsPngOfSaneSides(bytes))
    return Bad(fmt::format("{} is no PNG of at most {} px a side", path.filename().string(), kMaxImageSide));
  cv::Mat picture;
  try {
    picture = cv::imdecode(bytes, cv::IMREAD_COLOR);
    if (!picture.empty()) cv::cvtColor(picture, picture, cv::COLOR_BGR2RGB);
  } catch (const cv::Exception& error) {
    return Bad(fmt::format("{}: {}", path.filename().string(), error.what()));
  }
  if (width == 0) {
    width = picture.cols;
    height = picture.rows;
  }
  if (picture.empty() || picture.cols != width || picture.rows != height)
    return Bad(fmt::format("{} is no picture of {}x{} px", path.filename().string(), width, height));
  return picture;
}

// One step of one episode after the other.
class Converter {
 public:
  Converter(const Fingers& fingers, Episode& episode) : fingers_(fingers), episode_(episode) {}

  Status Add(const OrderedJson& step) {
    ETUDE_RETURN_IF_ERROR(AddJoints(step));
    const auto tracked = step.find("objects_to_track");
    if (tracked == step.end() || !tracked->is_object() || !tracked->contains("EE"))
      return Bad("'objects_to_track' has no EE");
    ETUDE_ASSIGN_OR_RETURN(const Pose hand, PoseOf((*tracked)["EE"]));
    ETUDE_RETURN_IF_ERROR(AddObjects(*tracked));
    Append(episode_.eef_pos, {hand.p.x(), hand.p.y(), hand.p.z()});
    Append(episode_.eef_quat, {hand.q.w(), hand.q.x(), hand.q.y(), hand.q.z()});
    AppendPixel(episode_.eef_pixel, camera(), hand.p);
    ETUDE_RETURN_IF_ERROR(AddAction(step, hand));
    return AddStage(step);
  }

 private:
  const Camera& camera() const { return episode_.cameras[0].camera; }

  // arm joints, then the driven finger
  Status AddJoints(const OrderedJson& step) {
    const std::size_t known = static_cast<std::size_t>(episode_.joint_pos.columns);
    const std::size_t least = known == 0 ? 2 : known + 1, most = known == 0 ? 16 : known + 1;
    ETUDE_ASSIGN_OR_RETURN(const auto q, Numbers(step, "q", least, most));
    ETUDE_ASSIGN_OR_RETURN(const auto dq, Numbers(step, "dq", q.size(), q.size()));
    const std::size_t arm = q.size() - 1;
    Append(episode_.joint_pos, q, 0, arm);
    Append(episode_.joint_vel, dq, 0, arm);
    Append(episode_.gripper_qpos, q, arm, arm + 1);
    finger_ = q[arm];
    return {};
  }

  Status AddObjects(const OrderedJson& tracked) {
    std::size_t seen = 0;
    for (const auto& [theirs, state] : tracked.items()) {
      if (theirs == "EE") continue;
      const std::string name = ObjectName(theirs);
      const auto object = std::find_if(episode_.objects.begin(), episode_.objects.end(),
                                       [&](const ObjectTrack& track) { return track.name == name; });
      if (object == episode_.objects.end()) return Bad(fmt::format("object '{:.64}' is not in every step", theirs));
      auto pose = PoseOf(state);
      if (!pose) return Fail(pose.error().Wrap(theirs));
      const auto& [p, q] = *pose;
      Append(object->pose, {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()});
      AppendPixel(object->pixel, camera(), p);
      ++seen;
    }
    if (seen != episode_.objects.size()) return Bad("an object is not in every step");
    return {};
  }

  // where the arm was told to go; the gripper's command was not recorded, its angle follows within a few steps
  Status AddAction(const OrderedJson& step, const Pose& hand) {
    Pose goal = hand;
    if (step.contains("target")) {
      ETUDE_ASSIGN_OR_RETURN(const auto target, Numbers(step, "target", 6, 6));
      goal = {{target[0], target[1], target[2]}, FromEuler({target[3], target[4], target[5]})};
    }
    const bool closed = fingers_.closed_above ? finger_ > fingers_.threshold : finger_ <= fingers_.threshold;
    const auto action = ToVector({goal, closed ? 1.0 : 0.0});
    episode_.actions_abs.columns = kWaypointSize;
    episode_.actions_abs.Push(action);
    return {};
  }

  Status AddStage(const OrderedJson& step) {
    const auto stage = step.find("stage");
    if (stage == step.end() || !stage->is_number_integer() || stage->get<std::int64_t>() < 0 ||
        stage->get<std::int64_t>() > 200)
      return Bad("'stage' is no number of 0 to 200");
    const auto number = stage->get<std::size_t>();
    while (episode_.stage_names.size() <= number)
      episode_.stage_names.push_back(fmt::format("stage {}", episode_.stage_names.size()));
    episode_.phase.push_back(static_cast<std::uint8_t>(number));
    episode_.supervise.push_back(1);
    return {};
  }

  const Fingers& fingers_;
  Episode& episode_;
  double finger_ = 0;
};

class Importer {
 public:
  Importer(const Fingers& fingers, const language::Grammar& grammar, const Path& out, const ModattnOptions& options,
           std::size_t recordings, Survey survey)
      : fingers_(fingers),
        grammar_(grammar),
        out_(out),
        options_(options),
        recordings_(recordings),
        survey_(std::move(survey)) {}

  Status Add(const Recording& recording) {
    const auto episode = Convert(recording);
    if (!episode) {
      if (!writer_) Forget();
      return Fail(episode.error());
    }
    if (!writer_) {
      ETUDE_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Open(out_, *spec_));
    }
    ETUDE_RETURN_IF_ERROR(writer_->Commit(*episode));
    ++count_;
    return {};
  }

  std::uint64_t count() const { return count_; }
  Status Finish() {
    ETUDE_RETURN_IF_ERROR(writer_->WriteMaster());
    writer_.reset();
    return store::MarkDerived(out_);  // one that was skipped will not come, either
  }

 private:
  // an episode that is left out does not settle what those after it must be like
  void Forget() {
    spec_.reset();
    width_ = height_ = 0;
  }

  Result<Episode> Convert(const Recording& recording) {
    ETUDE_ASSIGN_OR_RETURN(const OrderedJson states, ReadStates(recording.folder));
    Episode episode;
    ETUDE_RETURN_IF_ERROR(Describe(states.front(), recording, episode));
    ETUDE_RETURN_IF_ERROR(ReadPictures(recording.folder, states.size(), episode));
    FitSpec();
    episode.spec_sha256 = SpecHash(*spec_);
    Converter converter(fingers_, episode);
    for (std::size_t t = 0; t < states.size(); ++t)
      if (Status added = converter.Add(states[t]); !added) return Fail(added.error().Wrap(fmt::format("step {}", t)));
    // now, not by the writer: what it has been opened with stays
    ETUDE_RETURN_IF_ERROR(ValidateEpisode(episode));
    return episode;
  }

  Status Describe(const OrderedJson& first, const Recording& recording, Episode& episode) {
    ETUDE_ASSIGN_OR_RETURN(episode.task, Word(first, "action_inst"));
    ETUDE_ASSIGN_OR_RETURN(const std::string goal, Word(first, "goal_object"));
    episode.target = ObjectName(goal);
    const language::Command command{episode.task, episode.target};
    ETUDE_RETURN_IF_ERROR(grammar_.Check(command));
    Rng rng(MixSeed({count_}, "modattn"));
    episode.instruction = grammar_.Sample(command, language::Style::kTemplate, rng);
    const auto tracked = first.find("objects_to_track");
    if (tracked == first.end() || !tracked->is_object()) return Bad("'objects_to_track' is no map");
    for (const auto& [theirs, state] : tracked->items())
      if (theirs != "EE") episode.objects.emplace_back().name = ObjectName(theirs);
    if (episode.FindObject(episode.target) == nullptr)
      return Bad(fmt::format("the goal '{:.64}' is not tracked", goal));
    episode.campaign = options_.name;
    episode.index = count_;
    episode.version = "modattn";
    episode.robot = options_.robot;
    episode.success = true;
    episode.image_stride = 1;
    episode.scene_sha256 = std::string(64, '0');
    episode.details = {{"source", "modattn"}, {"folder", recording.name}, {"judged", false}};
    return {};
  }

  Status ReadPictures(const Path& folder, std::size_t steps, Episode& episode) {
    CameraTrack track;
    int width = width_, height = height_;
    std::optional<codec::FrameDeflater> frames;
    for (std::size_t t = 0; t < steps; ++t) {
      ETUDE_ASSIGN_OR_RETURN(const cv::Mat picture, ReadPicture(folder / fmt::format("{}.png", t), width, height));
      if (!frames) frames.emplace(codec::LayoutFor(width, height));
      frames->Add({picture.data, picture.total() * 3});
    }
    if (frames) {
      codec::DeflatedFrames deflated = frames->Finish();
      ETUDE_CHECK(deflated.count == steps, "{} of {} steps", deflated.count, steps);
      track.Take(std::move(deflated));
    }
    width_ = width;
    height_ = height;
    CameraSpec camera;
    camera.width = width;
    camera.height = height;
    camera.fovy_deg = options_.fovy_deg;
    track.camera = ToCamera(camera);
    episode.cameras.push_back(std::move(track));
    return {};
  }

  // nothing of this campaign can be made again
  void FitSpec() {
    if (spec_) return;
    spec_.emplace();
    spec_->name = options_.name;
    spec_->seed = survey_.seed;
    spec_->episodes = recordings_;
    spec_->robots = {options_.robot};
    spec_->tasks = survey_.tasks;
    spec_->objects = survey_.objects;
    if (survey_.objects.size() > survey_.together) spec_->objects_per_scene = static_cast<int>(survey_.together);
    spec_->image_stride = 1;
    spec_->camera.width = width_;
    spec_->camera.height = height_;
    spec_->camera.fovy_deg = options_.fovy_deg;
    spec_->randomization.yaw = spec_->randomization.start_position = spec_->randomization.start_orientation = 0;
    spec_->randomization.disturbance_probability = 0;
  }

  const Fingers& fingers_;
  const language::Grammar& grammar_;
  Path out_;
  const ModattnOptions& options_;
  const std::size_t recordings_;
  const Survey survey_;
  std::optional<CampaignSpec> spec_;
  std::optional<store::DatasetWriter> writer_;
  std::uint64_t count_ = 0;
  int width_ = 0, height_ = 0;  // of pictures, once known
};

Result<Fingers> FingersOf(const std::string& robot) {
  for (const Fingers& fingers : kFingers)
    if (robot == fingers.robot) return fingers;
  return Bad(fmt::format("robot '{}': published demonstrations are of ur5, jaco2 or panda", robot));
}

}  // namespace

Result<ModattnReport> ImportModattn(const Path& folder, const Path& out, const ModattnOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const Fingers fingers, FingersOf(options.robot));
  if (!IsPlainName(options.name) || !(options.fovy_deg > 0 && options.fovy_deg < 180))
    return Bad(fmt::format("name '{}' must be plain (a-z, 0-9, _ and -), field of view {} in (0, 180) degrees",
                           options.name, options.fovy_deg));
  ETUDE_ASSIGN_OR_RETURN(const auto recordings, ListRecordings(folder));
  ETUDE_ASSIGN_OR_RETURN(const auto grammar, language::Grammar::Load());
  ETUDE_ASSIGN_OR_RETURN(auto place, OutputFolder::Create(out, options.leftover));
  ModattnReport report;
  Importer importer(fingers, grammar, place.path(), options, recordings.size(), SurveyOf(recordings, grammar));
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    if (StopRequested())
      return Fail(Code::kExhausted, fmt::format("stopped after {} of {} episodes; what is there lies in '{}' "
                                                "(--restart begins anew)",
                                                i, recordings.size(), place.path().string()));
    if (Status added = importer.Add(recordings[i]); !added) {
      const bool disk = added.error().code == Code::kUnavailable;
      if (disk || !options.skip_bad)
        return Fail(added.error().Wrap(fmt::format("import '{}'", recordings[i].folder.string())));
      report.skipped.push_back(recordings[i].name + ": " + added.error().message);
    }
    if (options.progress) options.progress(i + 1, recordings.size());
  }
  report.episodes = importer.count();
  if (report.episodes == 0)
    return Fail(Code::kNotFound, fmt::format("import '{}': none of {} episodes can be read; the first: {}",
                                             folder.string(), recordings.size(), report.skipped.front()));
  ETUDE_RETURN_IF_ERROR(importer.Finish());
  ETUDE_RETURN_IF_ERROR(place.Commit());
  return report;
}

}  // namespace etude::exports
