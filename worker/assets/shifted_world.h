// SPDX-License-Identifier: Apache-2.0
// A scene under other light, on another table, with other colours and friction (see WorldSpec).
#pragma once

#include "services/spec/world_spec.h"
#include "worker/assets/scene_description.h"

namespace etude::assets {

/// Rewrites `scene.mjcf` and its files; the nominal world changes nothing. `world` has passed its Check.
/// Leaves sha256 to the caller.
void ShiftWorld(const WorldSpec& world, SceneDescription& scene);

}  // namespace etude::assets
