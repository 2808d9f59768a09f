// SPDX-License-Identifier: Apache-2.0
// What a person moves: checks, and objects that slide.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "services/core/config.h"
#include "worker/task/play_session.h"
#include "worker/task/smooth_step.h"

namespace etude::task {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kParkedBehind = 6.0;  // m along y, on the camera's side: behind it as it looks at the table
constexpr double kParkedApart = 0.5;   // m
constexpr int kLooks = 16;             // along the way of what is nudged

}  // namespace

Result<const sim::ObjectInfo*> PlaySession::Free(const std::string& name) const {
  const auto& objects = environment_->scene->objects();
  const auto object = std::ranges::find(objects, name, &sim::ObjectInfo::name);
  if (object == objects.end())
    return Fail(Code::kInvalidArgument, "object " + NotKnown(name.substr(0, 40), NamesOf(objects)));
  if (hidden(name)) return Fail(Code::kUnavailable, fmt::format("{} is hidden: show it first", name));
  if (slide_) return Fail(Code::kUnavailable, fmt::format("{} is being moved: wait for that", slide_->object));
  if (world().Grasped(name)) return Fail(Code::kUnavailable, fmt::format("{} is held by the robot", name));
  return &*object;
}

Status PlaySession::CheckFree(const sim::ObjectInfo& object, const ObjectPlace& at,
                              const std::vector<ObjectPlace>& moved) const {
  std::vector<ObjectPlace> places{at};
  for (const auto& other : environment_->scene->objects())
    if (other.name != object.name && !hidden(other.name) && !IsAmong(moved, other.name))
      places.push_back(PlaceOf(other.name, world().ObjectPose(other.name)));
  const auto& all = environment_->scene->objects();
  // the others may lie as the robot left them: only this one has to find room
  for (std::size_t i = 1; i < places.size(); ++i) {
    const auto other = std::ranges::find(all, places[i].name, &sim::ObjectInfo::name);
    if (Overlap(object, at, *other, places[i]))
      return Fail(Code::kInvalidArgument, fmt::format("{} would be where {} is", object.name, other->name));
  }
  ETUDE_ASSIGN_OR_RETURN(const auto alone, PlaceUpright({object}, {at}));
  (void)alone;
  return {};
}

// Against what stays where it is, and the arm as it stands.
Result<std::vector<PlacedObject>> PlaySession::Replaced(const std::vector<ObjectPlace>& places) const {
  EpisodeEnvironment& in = *environment_;
  ETUDE_ASSIGN_OR_RETURN(auto placed, PlaceUpright(in.scene->objects(), places));
  in.checker.ClearObjects();
  in.checker.SetGripper(in.world.gripper());
  for (std::size_t i = 0; i < places.size(); ++i) {
    ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(places[i].name));
    ETUDE_RETURN_IF_ERROR(CheckFree(*object, places[i], places));
    in.checker.SetObject(placed[i].name, placed[i].X_WO);
  }
  for (const auto& near : in.checker.Distances(in.world.q(), kStartMargin))
    if (IsAmong(places, near.body_b)) return Fail(InTheArm(near.body_b, near.body_a));
  return placed;
}

Status PlaySession::Place(const std::vector<ObjectPlace>& places) {
  if (doing_ != kAtRest) return Fail(Code::kUnavailable, "place objects: the policy drives: stop it first");
  ETUDE_ASSIGN_OR_RETURN(const auto placed, Replaced(places));
  sim::World& world = environment_->world;
  std::vector<PlacedObject> before;
  for (const auto& object : environment_->scene->objects())
    before.push_back({object.name, world.ObjectPose(object.name)});
  SetObjects(world, placed);
  Rest(kPlacedSettleSteps);
  if (const Status rests = CheckAtRest(world, placed); !rests) {
    SetObjects(world, before);
    return rests;
  }
  std::erase_if(places_, [&](const ObjectPlace& old) { return IsAmong(places, old.name); });
  places_.insert(places_.end(), places.begin(), places.end());
  return {};
}

// Also while a policy drives: who asks the checker then says where the objects are and what may touch first.
Status PlaySession::CheckArm(const std::string& name, const Pose& X_WO) const {
  EpisodeEnvironment& in = *environment_;
  const collide::WithGripper measured(in.checker, in.world.gripper());
  in.checker.ClearObjects();
  in.checker.Allow({});
  in.checker.SetObject(name, X_WO);
  const auto near = in.checker.Distances(in.world.q(), kStartMargin);
  const auto touched = std::ranges::find(near, name, &collide::Proximity::body_b);
  return touched == near.end() ? Status() : Fail(InTheArm(name, touched->body_a));
}

Status PlaySession::Nudge(const std::string& name, double dx, double dy) {
  ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(name));
  const double length = std::hypot(dx, dy);
  if (!std::isfinite(length) || length > kMostNudge)
    return Fail(Code::kInvalidArgument,
                fmt::format("nudge {} by ({:.3f}, {:.3f}) m: at most {:.2f} m", name, dx, dy, kMostNudge));
  const Pose from = world().ObjectPose(name);
  Pose to = from;
  to.p += Eigen::Vector3d(dx, dy, 0);
  const auto on_the_way = [&](double share) { return Pose{from.p + share * (to.p - from.p), from.q}; };
  ETUDE_RETURN_IF_ERROR(CheckFree(*object, PlaceOf(name, to)));
  // it would take along what stands between; out of what it leans on it may go
  const bool stands_free = CheckFree(*object, PlaceOf(name, from)).has_value();
  for (int i = 1; i < kLooks && stands_free; ++i)
    ETUDE_RETURN_IF_ERROR(CheckFree(*object, PlaceOf(name, on_the_way(static_cast<double>(i) / kLooks))));
  for (const double share : {0.5, 1.0}) ETUDE_RETURN_IF_ERROR(CheckArm(name, on_the_way(share)));
  return Move({.object = name, .from = from, .to = to, .step = 0, .steps = kNudgeSteps});
}

Status PlaySession::Hide(const std::string& name) {
  ETUDE_ASSIGN_OR_RETURN(const sim::ObjectInfo* const object, Free(name));
  const Pose from = world().ObjectPose(name);
  const auto& objects = environment_->scene->objects();
  const auto number = static_cast<double>(object - objects.data());
  const double side = (camera().X_WC.q * Eigen::Vector3d::UnitZ()).y() < 0 ? -1 : 1;  // it looks along its -z
  const Pose to{{kParkedApart * number, side * kParkedBehind, object->rest_height}, Eigen::Quaterniond::Identity()};
  hidden_[name] = from;
  return Move({.object = name, .from = to, .to = to, .step = 0, .steps = 1});
}

Status PlaySession::Show(const std::string& name) {
  const auto found = hidden_.find(name);
  if (found == hidden_.end()) return Fail(Code::kInvalidArgument, fmt::format("{:.40} is not hidden", name));
  const Pose to = found->second;
  const auto& objects = environment_->scene->objects();
  const auto object = std::ranges::find(objects, name, &sim::ObjectInfo::name);
  hidden_.erase(found);
  Status free;
  if (slide_) free = Fail(Code::kUnavailable, fmt::format("{} is being moved: wait for that", slide_->object));
  if (free) free = CheckFree(*object, PlaceOf(name, to));
  if (free) free = CheckArm(name, to);
  if (free) return Move({.object = name, .from = to, .to = to, .step = 0, .steps = 1});
  hidden_[name] = to;
  return free;
}

Status PlaySession::Move(Slide slide) {
  slide_ = std::move(slide);
  // while the arm comes home, or a policy drives, it goes on with their steps
  if (doing_ == kAtRest) Rest(slide_->steps + kPlacedSettleSteps);
  return {};
}

void PlaySession::GoOnSliding() {
  if (!slide_) return;
  Slide& slide = *slide_;
  const double s = static_cast<double>(++slide.step) / slide.steps;
  const double rate = SmoothStepRate(s) * kControlRate / slide.steps;
  const Eigen::Vector3d by = slide.to.p - slide.from.p;
  const Pose X_WO{slide.from.p + SmoothStep(s) * by, slide.from.q};
  if (running_)
    running_->PushObject(slide.object, X_WO, rate * by);  // the judge counts only what the robot does
  else
    environment_->world.Guide(slide.object, X_WO, rate * by);
  if (slide.step == slide.steps) slide_.reset();
}

void PlaySession::Rest(int steps) {
  sim::World& world = environment_->world;
  const Waypoint here{world.X_WE(), closed_ ? 1.0 : 0.0};
  for (int step = 0; step < steps; ++step) {
    GoOnSliding();
    world.Step(here, Vector6d::Zero());
  }
}

}  // namespace etude::task
