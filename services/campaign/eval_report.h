// SPDX-License-Identifier: Apache-2.0
// The report of an evaluation: success per task by both criteria with Wilson intervals, violations, and how far the
// modules' outputs were from the truth while the policy drove.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "services/core/config.h"
#include "services/core/file.h"
#include "services/episode/episode.h"
#include "services/spec/campaign_spec.h"

namespace etude::campaign {

/// Error of a module's output, cm, above which the decision that is made of it counts as bad: about what a grasp
/// forgives.
inline constexpr double kBadDecision_cm = 2;

/// The first decision of a rollout of which a module's output was off by more than kBadDecision_cm; of several modules
/// the one that was off most.
struct FirstBad {
  std::string module;
  int decision = 0;        ///< counts from 0
  std::uint64_t step = 0;  ///< control step
  double error_cm = 0;
};

/// One rollout, as eval.json lists it.
struct RolloutRow {
  std::uint64_t index = 0;
  std::uint64_t seed = 0;
  std::string robot, task, target, reference, instruction;
  bool success = false;          ///< the strict condition was held, without a violation
  bool success_latched = false;  ///< the authors' criterion, from the same rollout
  std::string outcome;
  std::set<std::string> violations;    ///< kinds: contact | self_contact | joint_speed | torque
  std::vector<std::string> disturbed;  ///< objects other than the target that moved by more than 2 cm
  int steps = 0;
  int decisions = 0;
  int latency_steps = 0;              ///< control steps between a picture and its answer taking effect
  std::uint64_t checkpoint_step = 0;  ///< of the last decision
  /// Module -> mean error over the rollout's decisions, cm; a module without a number is absent (a rollout
  /// that never had to decide, or a policy without that module).
  std::map<std::string, double> error_cm;
  std::map<std::string, double> error_before_contact_cm;  ///< of the decisions before the arm touched the target
  std::optional<FirstBad> first_bad;
  std::optional<double> covered;  ///< mean share of the target's pixels under blocks; only where some were to be
  std::optional<int> pushes;      ///< of the target; only where some were wanted
  int pushes_missed = 0;
  double wall_s = 0;  ///< that the rollout took, by the clock; 0: not known. Not of the episode: RowOf leaves it
};

/// What is evaluated: nothing of it is in the rollouts. What is empty is not known.
struct EvalSubject {
  std::string run_id, run;  ///< of the policy
  std::string sha256;       ///< of the checkpoint, as 64 hexadecimal digits
  std::uint64_t step = 0;   ///< of the checkpoint
  std::string file;         ///< of the checkpoint
  std::string dataset;      ///< that it was trained on: the checkpoint's fingerprint of it
  double created = 0;       ///< of the evaluation, seconds since 1970
};
/// `evaluation`/eval.json; nothing where there is none, or what is no JSON: whoever goes on makes it anew from the
/// rollouts.
OrderedJson ReadReport(const Path& evaluation);
/// As an earlier report says it; empty where that is none.
EvalSubject SubjectOf(const OrderedJson& report);
/// How many rollouts `report` is of; 0: it does not say.
std::uint64_t RolloutsOf(const OrderedJson& report);

/// Reads what the worker recorded in episode.details: "success_latched", "violations" (a list of {"kind", ...}),
/// "disturbed_objects", "latency_steps", "occlusion" ({"covered"}), "pushes" (a list), "pushes_missed", and
/// "decisions", a list with one map a decision: {"step": n, "checkpoint_step": n, "touched": bool, "error_m": {MODULE:
/// m}}. What is missing or not finite is left out.
RolloutRow RowOf(const Episode& rollout);

/// What scenes and verdicts depend on beside the spec: {"tasks": {NAME: SHA-256 of its file}, "content", "rollout"},
/// the versions of services/spec/content_version.h. Evaluations of different ones are not compared.
OrderedJson EvalRules(const CampaignSpec& spec);

/// {"per_task": [...], "overall": {...}, "per_episode": [...]}: n; by each criterion successes, their share and
/// Wilson's low and high ("success": strict, "success_latched": the authors'); rollouts with violations, by kind, and
/// with other objects moved; error_cm and error_before_contact_cm per module: means over rollouts of their means.
/// Before them "policy" {"run_id", "run", "sha256", "step", "file"}, "dataset", "judge" and "created" say what was
/// evaluated. What a spec asks for beyond that is added by suite_report.h. "spec" is the spec itself, so that a report
/// can be paired with another when its rollouts are gone.
OrderedJson EvalReport(const CampaignSpec& spec, const std::map<std::uint64_t, RolloutRow>& rows,
                       const EvalSubject& subject = {});

/// A row as eval.json's "per_episode" and eval.jsonl have it.
OrderedJson RowJson(const RolloutRow& row);

/// {"successes", "share", "low", "high"}: Wilson's interval.
OrderedJson ShareJson(std::uint64_t successes, std::uint64_t n);
/// "50.0 [15.0, 85.0]", in %. @param share  of ShareJson
std::string ShareText(const OrderedJson& share);

/// The report as a table for a terminal, and what its columns mean.
std::string EvalTable(const OrderedJson& report);

}  // namespace etude::campaign
