// SPDX-License-Identifier: Apache-2.0
// Outcomes that decide what comes next, and what. The others only say why an attempt failed (worker/task/verdict.h).
#pragma once

#include <string>

namespace etude {

struct CampaignSpec;

/// Outcome of an AttemptReport that releases the lease undone; nothing is counted.
inline constexpr char kReleased[] = "released";
/// "reason" in the details of a kReleased report: the host's child that worked on it is no more.
inline constexpr char kChildCrashed[] = "child_crashed";
inline constexpr char kChildHung[] = "child_hung";
/// true in them: not from outside (SIGKILL), so that the attempt itself may have done it.
inline constexpr char kByAttempt[] = "by_attempt";
/// Outcome of an attempt that ended so many workers (LeaseTableConfig::max_deaths): the next one is made instead.
inline constexpr char kKillsWorkers[] = "kills_workers";
/// What the collector counts when an episode does not fit what was leased; the same attempt is tried again.
inline constexpr char kUnfitEpisode[] = "unfit_episode";
/// Outcome of a rollout whose policy did not answer; the same attempt is tried again.
inline constexpr char kPolicyError[] = "policy_error";
/// true in its details: no policy can be asked as things are (it was trained for another robot, several have the name),
/// so that waiting does not help and the evaluation ends.
inline constexpr char kPolicyRefused[] = "refused";
/// The task cannot be done from the start that was drawn, or there was none. In a rollout, where each attempt has the
/// same start, the index is closed without a result.
inline constexpr char kSceneInvalid[] = "scene_invalid";
/// Outcome of a line of attempts.jsonl that is no failed attempt: another host made a committed episode again and came
/// to other bytes, or to none. What was committed stays.
inline constexpr char kRecheckMismatch[] = "recheck_mismatch";

enum class Retry { kNextAttempt, kSameAttempt, kNever };

/// What follows from a failed attempt of this outcome, as collectors and whoever reads attempts.jsonl count it.
Retry RetryOf(const CampaignSpec& spec, const std::string& outcome);

}  // namespace etude
