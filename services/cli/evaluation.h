// SPDX-License-Identifier: Apache-2.0
// Rollouts of a policy on fresh scenes: what `eval` and `up` have in common.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/participant.h"
#include "services/campaign/eval_report.h"
#include "services/cli/hosted_campaign.h"
#include "services/core/config.h"
#include "services/core/file.h"
#include "services/core/progress.h"
#include "services/core/result.h"
#include "services/spec/campaign_spec.h"

namespace etude::cli {

struct EvaluationOptions {
  std::string run;                 ///< name under which the policy answers
  std::vector<std::string> tasks;  ///< empty: those of the campaign whose scenes are used
  std::uint64_t episodes = 80;
  std::uint64_t seed = 1;
  int videos = 12;       ///< at most so many mp4 files, failures first
  bool overlay = false;  ///< they show what the policy saw and said, see overlay.h
  bool insight = false;  ///< that is kept of each rollout, see WriteInsights
  /// In place of the campaign's; sentences bring their tasks.
  std::optional<double> occlude;
  std::optional<int> pushes;
  std::vector<SentenceSpec> sentences;
  Path out;
  campaign::EvalSubject subject;  ///< what is known of the policy before it is asked
  Path run_folder;                ///< of the run that is followed; "": not known
};

/// The rollout campaign of an evaluation, from a campaign whose scenes it shares, and whose tasks and weights unless
/// `options` name others. Pick, push and put down without weights are weighted 4:3:3 (80 = 32 pick, 24 push, 24 put
/// down). Sentences bring their own tasks, in the order in which they first come. The seed is mixed with a constant of
/// evaluations, so that no rollout's scene is one that a collection with any seed drew.
CampaignSpec EvaluationSpec(const CampaignSpec& base, const EvaluationOptions& options);

/// @error kInvalidArgument: an overlay without videos, or one of overlay and insights without recorded pictures
Status CheckOverlay(const EvaluationOptions& options, const CampaignSpec& spec);

/// Runs the campaign with local workers and writes OUT/eval.jsonl and OUT/eval.json as it goes, then OUT/videos and
/// OUT/insights, for which the policy is asked once more.
/// @param watch  called a few times a second; an error ends the evaluation (e.g. the policy died)
/// @returns the report (see campaign::EvalReport). A stop request is no error: the report has what is done.
Result<OrderedJson> Evaluate(const bus::Participant& participant, const CampaignSpec& spec,
                             const EvaluationOptions& options, const HostOptions& host, ProgressDisplay& display,
                             const std::function<Status()>& watch);

}  // namespace etude::cli
