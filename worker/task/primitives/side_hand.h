// SPDX-License-Identifier: Apache-2.0
// What several primitives share about a level hand, along +y. Internal to worker/task.
#pragma once

#include "worker/task/primitives/stage.h"
#include "worker/task/primitives/tuning.h"

namespace etude::task::side {

/// y of E when the fingertips are round the target's axis, m.
double GraspY(const StageContext& now);
double GraspHeight(const StageContext& now);
/// The hand that pushes.
Eigen::Quaterniond PushHand();
/// Whether the hand points down, after a turn, rather than being level.
bool IsTurned(const StageContext& now);
/// Level or turned down, whichever the hand is nearer to.
inline Eigen::Quaterniond NearestHand(const StageContext& now) { return IsTurned(now) ? TurnedHand() : LevelHand(); }

}  // namespace etude::task::side
