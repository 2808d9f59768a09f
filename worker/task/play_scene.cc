// SPDX-License-Identifier: Apache-2.0
#include "worker/task/play_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "services/core/config.h"

namespace etude::task {
namespace {

constexpr double kSettleDistance = 0.01;  // m that an object may move by itself
constexpr double kSettleTilt = 0.05;      // rad

using Corners = std::array<Eigen::Vector2d, 4>;

Corners CornersOf(const sim::ObjectInfo& object, const ObjectPlace& at) {
  const Eigen::Rotation2Dd turned(at.yaw);
  const double x = object.half_extent.x(), y = object.half_extent.y();
  Corners corners{Eigen::Vector2d(x, y), {-x, y}, {-x, -y}, {x, -y}};
  for (auto& corner : corners) corner = turned * corner + Eigen::Vector2d(at.x, at.y);
  return corners;
}

std::pair<double, double> Shadow(const Corners& corners, const Eigen::Vector2d& axis) {
  double low = corners[0].dot(axis), high = low;
  for (const auto& corner : corners) {
    low = std::min(low, corner.dot(axis));
    high = std::max(high, corner.dot(axis));
  }
  return {low, high};
}

// Two rectangles are apart where some side of one of them has the other one beyond it.
bool ApartAlong(const Corners& a, const Corners& b, double yaw) {
  for (const double turn : {yaw, yaw + M_PI_2}) {
    const Eigen::Vector2d axis(std::cos(turn), std::sin(turn));
    const auto [a_low, a_high] = Shadow(a, axis);
    const auto [b_low, b_high] = Shadow(b, axis);
    if (a_low > b_high + kPlaceMargin || b_low > a_high + kPlaceMargin) return true;
  }
  return false;
}

std::string ProblemOf(const sim::ObjectInfo& object, const ObjectPlace& at) {
  if (!std::isfinite(at.x) || !std::isfinite(at.y) || !std::isfinite(at.yaw))
    return fmt::format("{}: its place is not finite", object.name);
  const double most = kTableHalf - kPlaceMargin;
  for (const auto& corner : CornersOf(object, at))
    if (std::abs(corner.x()) > most || std::abs(corner.y()) > most)
      return fmt::format("{} at ({:.3f}, {:.3f}) is not on the table, which reaches to {:.2f} m", object.name, at.x,
                         at.y, kTableHalf);
  return {};
}

}  // namespace

std::vector<std::string> NamesOf(const std::vector<sim::ObjectInfo>& objects) {
  std::vector<std::string> names;
  for (const auto& object : objects) names.push_back(object.name);
  return names;
}

double YawOf(const Pose& X_WO) {
  const Eigen::Vector3d x = X_WO.q * Eigen::Vector3d::UnitX();
  return std::atan2(x.y(), x.x());
}

ObjectPlace PlaceOf(const std::string& name, const Pose& X_WO) { return {name, X_WO.p.x(), X_WO.p.y(), YawOf(X_WO)}; }

bool Overlap(const sim::ObjectInfo& a, const ObjectPlace& at_a, const sim::ObjectInfo& b, const ObjectPlace& at_b) {
  const Corners corners_a = CornersOf(a, at_a), corners_b = CornersOf(b, at_b);
  return !ApartAlong(corners_a, corners_b, at_a.yaw) && !ApartAlong(corners_a, corners_b, at_b.yaw);
}

Result<std::vector<PlacedObject>> PlaceUpright(const std::vector<sim::ObjectInfo>& objects,
                                               const std::vector<ObjectPlace>& places) {
  std::vector<const sim::ObjectInfo*> placed;
  std::vector<PlacedObject> result;
  std::string problems;
  const auto refuse = [&](const std::string& why) { problems += (problems.empty() ? "" : "; ") + why; };
  for (const auto& place : places) {
    const auto object = std::ranges::find(objects, place.name, &sim::ObjectInfo::name);
    if (object == objects.end())
      return Fail(Code::kInvalidArgument, "place objects: " + NotKnown(place.name.substr(0, 40), NamesOf(objects)));
    if (const std::string why = ProblemOf(*object, place); !why.empty()) refuse(why);
    for (std::size_t i = 0; i < placed.size(); ++i) {
      if (placed[i]->name == place.name)
        refuse(fmt::format("{} is placed twice", place.name));
      else if (Overlap(*placed[i], places[i], *object, place))
        refuse(fmt::format("{} and {} are in one place", placed[i]->name, place.name));
    }
    placed.push_back(&*object);
    const Eigen::Quaterniond q(Eigen::AngleAxisd(place.yaw, Eigen::Vector3d::UnitZ()));
    result.push_back({place.name, {{place.x, place.y, object->rest_height}, q}});
  }
  if (!problems.empty()) return Fail(Code::kInvalidArgument, "place objects: " + problems);
  return result;
}

bool IsAmong(const std::vector<ObjectPlace>& places, std::string_view object) {
  return std::ranges::find(places, object, &ObjectPlace::name) != places.end();
}

Error InTheArm(const std::string& object, const std::string& body) {
  return {Code::kInvalidArgument, fmt::format("{} would be where the arm is ({})", object, body)};
}

void SetObjects(sim::World& world, const std::vector<PlacedObject>& objects) {
  for (const auto& object : objects) world.SetObject(object.name, object.X_WO);
  world.Forward();
}

Status CheckAtRest(const sim::World& world, const std::vector<PlacedObject>& objects) {
  for (const auto& object : objects) {
    const Pose X_WO = world.ObjectPose(object.name);
    const double moved = (X_WO.p - object.X_WO.p).norm();
    if (!world.healthy() || moved > kSettleDistance || AngleBetween(X_WO.q, object.X_WO.q) > kSettleTilt)
      return Fail(
          Code::kInvalidArgument,
          fmt::format("place objects: {} does not come to rest there: it moved by {:.3f} m", object.name, moved));
  }
  return {};
}

}  // namespace etude::task
