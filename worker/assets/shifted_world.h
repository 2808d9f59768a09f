// SPDX-License-Identifier: Apache-2.0
// A scene under other light, on another table, with other colours and friction (see WorldSpec).
#pragma once

#include "services/spec/world_spec.h"
#include "worker/assets/scene_description.h"

namespace etude::assets {

/// Rewrites `scene.mjcf` and its files; the nominal world changes nothing. `world` has passed its Check.
/// Leaves sha256 to the caller.
void ShiftWorld(const WorldSpec& world, SceneDescription& scene);

/// The name of the background's texture; that of a table is the table's.
inline constexpr const char* kBackgroundTexture = "background";

/// Adds what an episode may have instead of the campaign's own: SceneSpec::tables and SceneSpec::backdrop. Call it
/// after ShiftWorld. Leaves sha256 to the caller.
void AddChoices(const SceneSpec& spec, SceneDescription& scene);

}  // namespace etude::assets
