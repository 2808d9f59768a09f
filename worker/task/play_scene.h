// SPDX-License-Identifier: Apache-2.0
// Objects where a person puts them on the table.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "services/core/result.h"
#include "services/play/arguments.h"
#include "worker/sim/world.h"
#include "worker/task/scene_sampling.h"

namespace etude::task {

/// m that is left between two objects, and between an object and the edge of the table.
inline constexpr double kPlaceMargin = 0.005;
/// m of the table to every side of its centre, which is the world's origin.
inline constexpr double kTableHalf = 0.75;

using play::ObjectPlace;

/// Their names, in their order.
std::vector<std::string> NamesOf(const std::vector<sim::ObjectInfo>& objects);

/// The heading of an object: how far its x axis is turned about the vertical, rad.
double YawOf(const Pose& X_WO);
/// Where an object stands, apart from its height.
ObjectPlace PlaceOf(const std::string& name, const Pose& X_WO);

/// Whether the upright boxes of two objects are nearer than kPlaceMargin, seen from above.
bool Overlap(const sim::ObjectInfo& a, const ObjectPlace& at_a, const sim::ObjectInfo& b, const ObjectPlace& at_b);

/// The objects of a scene as they are to stand: each on the table and none in another's place.
/// @error kInvalidArgument: an object that the scene has not (with the nearest one), numbers that are not finite, a
/// place beside the table, two objects in one place; all problems at once
Result<std::vector<PlacedObject>> PlaceUpright(const std::vector<sim::ObjectInfo>& objects,
                                               const std::vector<ObjectPlace>& places);

/// Whether one of `places` is that of the object.
bool IsAmong(const std::vector<ObjectPlace>& places, std::string_view object);

/// Of an object that would be where `body` of the arm is.
Error InTheArm(const std::string& object, const std::string& body);

/// Objects as they are to stand, at rest there.
void SetObjects(sim::World& world, const std::vector<PlacedObject>& objects);
/// Whether they still are where SetObjects put them, some time later. @error kInvalidArgument: one has moved by itself
Status CheckAtRest(const sim::World& world, const std::vector<PlacedObject>& objects);

}  // namespace etude::task
