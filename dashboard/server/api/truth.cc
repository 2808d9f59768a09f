// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/truth.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string_view>

#include "dashboard/server/sources/files.h"
#include "services/episode/trajectory_label.h"
#include "services/language/grammar.h"
#include "services/spec/object_names.h"

namespace etude::api {
namespace {

using Eigen::Vector3d;
using sources::PartOf;
using sources::TextOf;

// One thing at a step, as labels are made of it (trainer/data/labels.h).
struct Thing {
  std::string name;  // "": the hand
  Pose X_W;
  std::vector<double> pixel;  // empty: not known
};

bool AllFinite(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float x) { return std::isfinite(x); });
}

// Nothing where the record does not say it.
std::optional<Thing> ThingAt(const std::string& name, std::span<const float> p, std::span<const float> q,
                             std::span<const float> pixel) {
  if (p.size() != 3 || q.size() != 4 || !AllFinite(p) || !AllFinite(q)) return std::nullopt;
  Thing thing{name, {{p[0], p[1], p[2]}, Eigen::Quaterniond(q[0], q[1], q[2], q[3])}, {}};
  if (pixel.size() == 2 && AllFinite(pixel)) thing.pixel = {pixel[0], pixel[1]};
  return thing;
}

std::span<const float> RowOf(const Track& track, int step) {
  return step < track.rows() ? track.row(step) : std::span<const float>{};
}

class Moment {
 public:
  Moment(const Episode& episode, int step, const TruthScope& scope) : episode_(episode), step_(step), scope_(scope) {
    const auto task = ParseTask(episode.task);
    command_ = task ? language::CommandFor(*task, episode.target, episode.reference)
                    : language::Command{episode.task, episode.target, episode.reference};
  }

  std::optional<Thing> Hand() const {
    return ThingAt("", RowOf(episode_.eef_pos, step_), RowOf(episode_.eef_quat, step_),
                   RowOf(episode_.eef_pixel, step_));
  }
  std::optional<Thing> Object(const ObjectTrack& object) const {
    const auto pose = RowOf(object.pose, step_);
    if (pose.size() != 7) return std::nullopt;
    return ThingAt(object.name, pose.first(3), pose.subspan(3), RowOf(object.pixel, step_));
  }
  // What a module's entity stands for here.
  std::optional<Thing> Meant(const std::string& entity) const {
    if (entity == "ee") return Hand();
    constexpr std::string_view kObject = "object:";
    if (entity.starts_with(kObject)) return Called(entity.substr(kObject.size()));
    if (!scope_.as_spoken) return std::nullopt;
    if (entity == "target") return Called(command_.target);
    if (entity == "reference") return Called(command_.reference);
    return entity == "obstacle" ? Called(command_.obstacle) : std::nullopt;
  }
  const Episode& episode() const { return episode_; }
  const std::string& task() const { return command_.task; }
  bool as_spoken() const { return scope_.as_spoken; }
  // x, y, z of the waypoints to imitate, up to the first that nobody is to.
  OrderedJson Waypoints() const;

 private:
  // by its name, or by its noun when a generated object is meant whatever its number
  std::optional<Thing> Called(const std::string& name) const {
    if (name.empty()) return std::nullopt;
    const ObjectTrack* object = episode_.FindObject(name);
    if (object == nullptr) {
      const auto found =
          std::ranges::find(episode_.objects, name, [](const auto& one) { return ObjectNoun(one.name); });
      if (found != episode_.objects.end()) object = &*found;
    }
    return object != nullptr ? Object(*object) : std::nullopt;
  }

  const Episode& episode_;
  const int step_;
  const TruthScope scope_;
  language::Command command_;
};

OrderedJson Moment::Waypoints() const {
  OrderedJson points = OrderedJson::array();
  const Track& commands = episode_.actions_abs;
  if (!scope_.as_spoken || !scope_.demonstrated || commands.columns != kWaypointSize || commands.rows() == 0)
    return points;
  const TrajectoryLabel label = LabelTrajectory(episode_, step_);
  for (int k = 0; k < kWaypoints && label.valid[k]; ++k) {
    const float* values = label.values.data() + k * kWaypointSize;
    points.push_back({values[0], values[1], values[2], values[kWaypointSize - 1]});
  }
  return points;
}

std::vector<double> NumbersOf(const OrderedJson& list, std::size_t size) {
  std::vector<double> numbers;
  if (!list.is_array() || list.size() != size) return numbers;
  for (const auto& number : list) {
    if (!number.is_number()) return {};
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

OrderedJson ListOf(const Vector3d& p) { return {p.x(), p.y(), p.z()}; }

std::optional<OrderedJson> ErrorOfName(const OrderedJson& says, const std::string& truth) {
  if (!PartOf(says, "value").is_string()) return std::nullopt;
  return OrderedJson{{"truth", truth}, {"error", TextOf(says, "value") == truth ? 0 : 1}, {"unit", "-"}};
}

// Of a module that says a place, or the way from the hand to one, in the first three of `size` numbers.
std::optional<OrderedJson> ErrorOfPlace(const OrderedJson& says, const Vector3d& truth, std::size_t size) {
  const auto said = NumbersOf(PartOf(says, "value"), size);
  if (said.empty()) return std::nullopt;
  return OrderedJson{
      {"truth", ListOf(truth)}, {"error", (Vector3d(said[0], said[1], said[2]) - truth).norm()}, {"unit", "m"}};
}

std::optional<OrderedJson> ErrorOfPose(const OrderedJson& says, const Pose& truth) {
  auto error = ErrorOfPlace(says, truth.p, 9);
  if (!error) return std::nullopt;
  const auto said = NumbersOf(PartOf(says, "value"), 9);
  const double turned = AngleBetween(truth.q, FromRotation6D({said[3], said[4], said[5], said[6], said[7], said[8]}));
  if (std::isfinite(turned)) (*error)["turned_rad"] = turned;
  return error;
}

std::optional<OrderedJson> ErrorOfPixel(const OrderedJson& says, const std::vector<double>& truth) {
  const auto said = NumbersOf(PartOf(says, "value"), 2);
  if (said.empty() || truth.size() != 2) return std::nullopt;
  return OrderedJson{{"truth", truth}, {"error", std::hypot(said[0] - truth[0], said[1] - truth[1])}, {"unit", "px"}};
}

// How far what a module says is from what is; nothing where that is not known.
std::optional<OrderedJson> ErrorOf(const OrderedJson& says, const Moment& moment) {
  const std::string quantity = TextOf(says, "quantity"), entity = TextOf(says, "entity");
  if (quantity == "task") return moment.as_spoken() ? ErrorOfName(says, moment.task()) : std::nullopt;
  const auto thing = moment.Meant(entity);
  if (!thing) return std::nullopt;
  if (quantity == "class") return ErrorOfName(says, ObjectNoun(thing->name));
  if (quantity == "pixel") return ErrorOfPixel(says, thing->pixel);
  if (quantity == "position") return ErrorOfPlace(says, thing->X_W.p, 3);
  if (quantity == "pose") return ErrorOfPose(says, thing->X_W);
  const auto hand = moment.Hand();
  if (quantity != "displacement" || !hand) return std::nullopt;
  return ErrorOfPlace(says, thing->X_W.p - hand->X_W.p, 3);
}

// Mean distance of the planned waypoints from those that are known, m; null: none is.
OrderedJson WaypointsError(const std::vector<Waypoint>& planned, const OrderedJson& truth) {
  const std::size_t count = std::min(planned.size(), truth.size());
  double sum = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const auto known = NumbersOf(truth[k], 4);
    sum += (planned[k].X_WE.p - Vector3d(known[0], known[1], known[2])).norm();
  }
  return count > 0 ? OrderedJson(sum / static_cast<double>(count)) : OrderedJson();
}

}  // namespace

OrderedJson TruthJson(const Episode& episode, int step, const policy::Insight& insight, const TruthScope& scope) {
  const Moment moment(episode, step, scope);
  OrderedJson pixels = OrderedJson::object(), positions = OrderedJson::object(), errors = OrderedJson::object();
  const auto put = [&](const std::string& name, const std::optional<Thing>& thing) {
    if (!thing) return;
    if (!thing->pixel.empty()) pixels[name] = thing->pixel;
    positions[name] = ListOf(thing->X_W.p);
  };
  put("hand", moment.Hand());
  for (const auto& object : episode.objects) put(object.name, moment.Object(object));
  for (const auto& [module, says] : insight.modules.items())
    if (auto error = ErrorOf(says, moment)) errors[module] = std::move(*error);
  const OrderedJson waypoints = moment.Waypoints();
  return {{"target", episode.target},
          {"reference", sources::TextOrNull(episode.reference)},
          {"instruction", episode.instruction},
          {"pixels", pixels},
          {"positions", positions},
          {"waypoints", waypoints},
          {"waypoints_error_m", WaypointsError(insight.waypoints, waypoints)},
          {"errors", errors}};
}

}  // namespace etude::api
