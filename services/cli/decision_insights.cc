// SPDX-License-Identifier: Apache-2.0
#include "services/cli/decision_insights.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <span>

#include "services/cli/file_names.h"
#include "services/core/stop.h"
#include "services/episode/codec.h"
#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"

namespace etude::cli {
namespace {

struct Decision {
  int step = 0;
  std::uint64_t checkpoint_step = 0;
};

// As worker/task writes them into Episode::details; what cannot be read is left out.
std::vector<Decision> DecisionsOf(const Episode& rollout) {
  std::vector<Decision> decisions;
  const auto listed = rollout.details.find("decisions");
  if (listed == rollout.details.end() || !listed->is_array()) return decisions;
  for (const auto& json : *listed) {
    const auto step = json.find("step"), checkpoint = json.find("checkpoint_step");
    if (step == json.end() || checkpoint == json.end()) continue;
    if (!step->is_number_integer() || !checkpoint->is_number_integer()) continue;
    const auto number = step->get<std::int64_t>();
    if (number >= 0 && number < rollout.steps())
      decisions.push_back({static_cast<int>(number), checkpoint->get<std::uint64_t>()});
  }
  return decisions;
}

// Number of the picture that the policy saw; nothing when it was not recorded.
std::optional<std::size_t> FrameAt(const Episode& rollout, int step) {
  if (step % rollout.image_stride != 0) return std::nullopt;
  const auto frame = static_cast<std::size_t>(step / rollout.image_stride);
  return frame < RecordedFrames(rollout, 0) ? std::optional(frame) : std::nullopt;
}

}  // namespace

std::string InsightTally::Text(const std::string& what) const {
  std::string text = fmt::format("{}: {} of {} decisions", what, shown, decisions);
  std::vector<std::string> reasons;
  const auto count = [&](std::uint64_t number, const std::string& reason) {
    if (number > 0) reasons.push_back(fmt::format("{} {}", number, reason));
  };
  count(other_checkpoint, "by another checkpoint than the one that is served now");
  count(unpictured, "at a step without a recorded picture (see rollout.replan_steps and image_stride)");
  count(unanswered, "without an answer (" + problem + ")");
  return reasons.empty() ? text : fmt::format("{}; without: {}", text, fmt::join(reasons, ", "));
}

Result<DecisionInsights> AskInsights(const Episode& rollout, const InsightFunction& ask, InsightTally& tally) {
  DecisionInsights insights;
  FrameCursor frames(rollout);
  for (const Decision& decision : DecisionsOf(rollout)) {
    ++tally.decisions;
    auto& insight = insights[decision.step];
    const auto frame = FrameAt(rollout, decision.step);
    if (!frame) {
      ++tally.unpictured;
      continue;
    }
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Frame(*frame));
    auto said = ask(policy::QuestionAt(rollout, decision.step, rgb));
    if (!said) {
      ++tally.unanswered;
      if (tally.problem.empty()) tally.problem = said.error().message;
    } else if (said->checkpoint_step != decision.checkpoint_step) {
      ++tally.other_checkpoint;
    } else {
      insight = std::move(*said);
      ++tally.shown;
    }
  }
  return insights;
}

namespace {

// False: nothing is known of it.
Result<bool> WriteInsightsOf(const Episode& rollout, const InsightFunction& ask, const Path& path,
                             InsightTally& tally) {
  if (rollout.cameras.empty() || rollout.cameras[0].streams.empty()) return false;
  ETUDE_ASSIGN_OR_RETURN(const DecisionInsights insights, AskInsights(rollout, ask, tally));
  const bool any = std::ranges::any_of(insights, [](const auto& one) { return one.second.has_value(); });
  // what was not asked to the end would stay without
  if (!any || StopRequested()) return false;
  ETUDE_ASSIGN_OR_RETURN(const std::size_t kept,
                         policy::WriteInsightFile(path, {rollout.index, rollout.seed, rollout.attempt}, insights));
  return kept > 0;
}

// A rollout that was made anew since has none yet; it is read only where there is a file to hold against it.
Result<bool> IsKept(const Path& path, const store::DatasetReader& rollouts, std::uint64_t index) {
  if (!IsMadeOf(path, store::EpisodePath(rollouts.path(), index))) return false;
  const auto kept = policy::InsightFile::Open(path);
  if (!kept) return false;
  ETUDE_ASSIGN_OR_RETURN(const store::EpisodeRecord record, rollouts.Read(index));
  return kept->of() == policy::InsightsOf{record.episode.index, record.episode.seed, record.episode.attempt};
}

}  // namespace

Result<std::vector<Path>> WriteInsights(const Path& rollouts, const Path& folder, const InsightFunction& ask,
                                        InsightTally& tally) {
  if (!ask && !std::filesystem::exists(folder)) return std::vector<Path>{};
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(rollouts));
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  if (ask) ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  std::vector<Path> files;
  for (const std::uint64_t index : indices) {
    const Path path = folder / policy::InsightFileName(index);
    ETUDE_ASSIGN_OR_RETURN(bool there, IsKept(path, reader, index));
    if (!there && ask && !StopRequested()) {
      ETUDE_ASSIGN_OR_RETURN(const Episode rollout, reader.ReadWhole(index));
      ETUDE_ASSIGN_OR_RETURN(there, WriteInsightsOf(rollout, ask, path, tally));
    }
    if (there) files.push_back(path);
  }
  return files;
}

}  // namespace etude::cli
