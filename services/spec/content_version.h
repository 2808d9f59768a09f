// SPDX-License-Identifier: Apache-2.0
// The number of what an episode's bytes depend on besides its spec.
#pragma once

#include <cstdint>

namespace etude {

/// Raised with every change that makes other bytes of the same (spec, index, attempt): expert, planners, physics,
/// meshes, renderer, encodings, libraries. Apart from the program's version, so that a release that changes no byte
/// goes on with the campaigns of the one before. Part of SpecHash, and what Episode::version says.
///   1  first release: EpisodePlan's streams, dense constraint Jacobian
///   2  strict judge and dwell, 6D rotations, sparse constraint Jacobian, scene draws and planner shares in details
///   3  bodies of the arm keep 12 mm from each other
///   4  a hand that has to close does so before it sets off where open fingers would touch something
///   5  plans of redundant arms keep the speeds that their controller makes of them
///   6  libm and llvmpipe in the same variants on every CPU (services/core/pinned_process.h)
///   7  a jaw that stays is a finger; arms of five joints are disturbed; obstacles stand clear of wide objects; a level
///      hand pushes deep ones; fingers that hear late (control_delay) are waited for
///   8  every robot meets every task: robots' and tasks' turns that ended together do not (9: nor weighted ones)
///   10 several frames a stream, so that what stands still is stored once (services/codec/frames.h)
inline constexpr std::uint32_t kContentVersion = 10;

/// The same of what only rollouts have: how a policy's answers are followed. Part of their SpecHash alone, so that
/// collected datasets go on.
///   2  the reference's velocity changes by bounded steps, whatever the next answer says
///   3  an answer is followed from where the reference is on its path; no joint is driven beyond its speed limit
///   4  fingers are waited for, and no answer opens them meanwhile to close them again; a hand that goes nowhere
///      follows one answer to its end; a target leads the hand by little, and a hand that is too fast is stopped
///   5  the nearer two bodies of the arm are, the slower they come nearer
inline constexpr std::uint32_t kRolloutVersion = 5;

}  // namespace etude
