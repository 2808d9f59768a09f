// SPDX-License-Identifier: Apache-2.0
#include "services/cli/evaluation.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/campaign/eval_report.h"
#include "services/campaign/spec_file.h"
#include "services/cli/decision_insights.h"
#include "services/cli/evaluation_record.h"
#include "services/cli/video.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/rng.h"
#include "services/core/stop.h"
#include "services/policy/insight_client.h"
#include "services/spec/attempt_outcome.h"

namespace etude::cli {

namespace {

// What is said settles what is done.
void SpeakSentences(const std::vector<SentenceSpec>& sentences, CampaignSpec& spec) {
  spec.rollout.sentences = sentences;
  spec.tasks.clear();
  spec.task_weights.clear();
  for (const auto& sentence : sentences)
    if (std::ranges::count(spec.tasks, sentence.task) == 0) spec.tasks.push_back(sentence.task);
}

}  // namespace

CampaignSpec EvaluationSpec(const CampaignSpec& base, const EvaluationOptions& options) {
  CampaignSpec spec = base;
  // the same folder has the same name, so that it can be resumed; two folders do not meet on the bus
  const Path folder = std::filesystem::weakly_canonical(std::filesystem::absolute(options.out));
  spec.name = "eval-" + Sha256Hex(folder.string()).substr(0, 12);
  spec.mode = "rollout";
  spec.adaptive_sampling = {};  // what a trainer lacks is no matter of what it is tested on
  spec.recheck = 0;             // an answer of a policy may come at another step there
  if (!options.tasks.empty()) {
    spec.tasks = options.tasks;
    spec.task_weights.clear();
  }
  if (spec.task_weights.empty() && spec.tasks == std::vector<std::string>{"pick", "push", "put_down"})
    spec.task_weights = {4, 3, 3};
  spec.episodes = options.episodes;
  spec.seed = MixSeed({options.seed}, "evaluation");
  spec.max_attempts = 3;
  spec.rollout.run = options.run;
  if (options.occlude) spec.rollout.occlude = *options.occlude;
  if (options.pushes) spec.rollout.pushes.count = *options.pushes;
  if (!options.sentences.empty()) SpeakSentences(options.sentences, spec);
  return spec;
}

namespace {

std::string RolloutLine(const campaign::CollectorProgress& progress, const Path& out) {
  std::string line = fmt::format("rollouts {}/{}", progress.committed, progress.total);
  const OrderedJson report = campaign::ReadReport(out);
  if (report.is_object() && report.contains("overall") && report["overall"]["success"].is_object() &&
      progress.committed > 0)
    line += fmt::format("  success {:.1f} %", 100 * report["overall"]["success"]["share"].get<double>());
  line += fmt::format("  {:.1f}/min  {} workers", progress.episodes_per_minute, progress.workers);
  if (progress.eta_s > 0) line += "  ETA " + FormatDuration(progress.eta_s);
  if (!progress.failures.empty())
    for (const auto& [reason, count] : progress.failures) line += fmt::format("  {} {}", reason, count);
  if (!progress.error.empty()) line += "  WAITING: " + progress.error;
  return line;
}

// What is written once the rollouts are over.
struct LookedBack {
  Result<std::vector<Path>> videos, insights;
};

// @param overlay, ask  null: what is there of these already stands
LookedBack WriteThem(const EvaluationOptions& options, Overlay* overlay, const InsightFunction& ask,
                     InsightTally& tally) {
  const Path rollouts = options.out / "rollouts";
  const int videos = options.overlay && overlay == nullptr ? 0 : options.videos;
  return {WriteVideos(rollouts, options.out / "videos", videos, overlay),
          WriteInsights(rollouts, options.out / "insights", ask, tally)};
}

// Where it is wanted, the policy is asked once more, and it is said how many decisions have their part. After a stop
// request nobody waits for answers: the next run writes what is left.
LookedBack LookBack(const bus::Participant& participant, const EvaluationOptions& options, const std::string& policy_id,
                    ProgressDisplay& display) {
  InsightTally tally;
  if ((!options.overlay && !options.insight) || StopRequested()) return WriteThem(options, nullptr, {}, tally);
  auto client = policy::InsightClient::Open(participant, Selector{options.run, policy_id}.text());
  if (!client) {
    Log().warn("cannot ask the policy once more: {}", client.error().message);
    return WriteThem(options, nullptr, {}, tally);
  }
  display.Show("asking the policy once more what it saw and said");
  const InsightFunction ask = [&client](const policy::Question& question) { return client->Ask(question); };
  Overlay overlay{ask, {}};
  auto written = WriteThem(options, options.overlay ? &overlay : nullptr, options.insight ? ask : nullptr, tally);
  if (overlay.tally.decisions > 0) display.Say(overlay.tally.Text());
  if (tally.decisions > 0) display.Say(tally.Text("insights"));
  return written;
}

}  // namespace

Status CheckOverlay(const EvaluationOptions& options, const CampaignSpec& spec) {
  if (options.insight && !spec.rollout.record)
    return Fail(Code::kInvalidArgument,
                "--insight asks the policy again about recorded pictures: rollout.record must be true");
  if (!options.overlay) return {};
  if (options.videos < 1)
    return Fail(Code::kInvalidArgument,
                fmt::format("--overlay is drawn into videos: --videos must be at least 1, is {}", options.videos));
  if (!spec.rollout.record)
    return Fail(Code::kInvalidArgument, "--overlay is drawn over recorded pictures: rollout.record must be true");
  return {};
}

Result<OrderedJson> Evaluate(const bus::Participant& participant, const CampaignSpec& spec,
                             const EvaluationOptions& options, const HostOptions& host, ProgressDisplay& display,
                             const std::function<Status()>& watch) {
  // a run that was evaluated before it trained on, say
  if (campaign::RolloutsOf(campaign::ReadReport(options.out)) >= spec.episodes)
    display.Say(fmt::format("all {} rollouts are in '{}' already: another --out evaluates again", spec.episodes,
                            options.out.string()));
  HostOptions with_subject = host;
  with_subject.subject = options.subject;
  ETUDE_ASSIGN_OR_RETURN(auto hosted, HostedCampaign::Start(participant, spec, with_subject));
  while (!hosted->ended() && !StopRequested()) {
    ETUDE_RETURN_IF_ERROR(hosted->Supervise());
    ETUDE_RETURN_IF_ERROR(watch());
    if (display.due()) display.Show(RolloutLine(hosted->progress(), options.out));
    WaitForStop(std::chrono::milliseconds(100));
  }
  ETUDE_RETURN_IF_ERROR(hosted->Finish());
  // `etude campaign stop` and the like, from elsewhere
  if (!hosted->progress().complete && !StopRequested())
    return Fail(Code::kExhausted,
                fmt::format("the rollouts in '{}' were stopped at {} of {}: run again to continue",
                            options.out.string(), hosted->progress().committed, hosted->progress().total));
  const auto& failures = hosted->progress().failures;
  const auto invalid = failures.contains(kSceneInvalid) ? failures.at(kSceneInvalid) : 0;
  if (const auto lost = hosted->progress().given_up - std::min(invalid, hosted->progress().given_up); lost > 0)
    Log().warn("{} rollouts could not be run and are not in the table; see {}/rollouts/attempts.jsonl", lost,
               options.out.string());

  // the rollouts are what counts: without videos the report still stands
  const auto [videos, insights] = LookBack(participant, options, host.policy_id, display);
  if (!videos) Log().warn("no videos: {}", videos.error().message);
  if (!insights) Log().warn("no insights: {}", insights.error().message);
  ETUDE_ASSIGN_OR_RETURN(auto report,
                         CompleteReport(options.out, options.run_folder, videos.value_or(std::vector<Path>{}),
                                        insights.value_or(std::vector<Path>{})));
  if (!StopRequested() && campaign::RolloutsOf(report) == 0)  // a share of nothing is no result
    return Fail(Code::kExhausted,
                fmt::format("not one of {} rollouts could be made; why is in '{}'", hosted->progress().total,
                            (options.out / "rollouts" / "attempts.jsonl").string()));
  return report;
}

}  // namespace etude::cli
