// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/spec_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "services/core/clock.h"
#include "services/core/share.h"
#include "services/spec/object_names.h"
#include "services/store/dataset.h"

namespace etude::campaign {
namespace {

std::string FailureText(const CollectorProgress& progress) {
  std::string text;
  for (const auto& [reason, count] : progress.failures)
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", reason, count);
  return text;
}

double SuccessPercent(const CollectorProgress& progress) {
  return progress.attempts == 0
             ? 0.0
             : 100.0 * static_cast<double>(progress.committed) / static_cast<double>(progress.attempts);
}

}  // namespace

Result<CampaignSpec> LoadSpec(const SpecArguments& arguments) {
  std::vector<std::string> overrides = arguments.overrides;
  if (arguments.episodes) overrides.push_back(fmt::format("episodes={}", *arguments.episodes));
  if (arguments.seed) overrides.push_back(fmt::format("seed={}", *arguments.seed));
  auto spec = LoadConfig<CampaignSpec>(arguments.file, overrides);
  if (!spec) {
    // a campaign file that is not there is a wrong argument
    if (spec.error().code == Code::kNotFound)
      return Fail(Code::kInvalidArgument, fmt::format("{}; campaign files are in {}", spec.error().message,
                                                      FindShared("campaigns").value_or("deploy/campaigns").string()));
    return Fail(spec.error());
  }
  ETUDE_ASSIGN_OR_RETURN(spec->objects, ExpandObjects(spec->objects));
  ETUDE_RETURN_IF_ERROR(spec->Validate());
  return spec;
}

Result<CampaignSpec> LoadSpecOrDataset(const SpecArguments& arguments) {
  std::error_code error;
  if (!std::filesystem::is_directory(arguments.file, error)) return LoadSpec(arguments);
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(arguments.file));
  return WithOverrides(reader.spec(), arguments.overrides);
}

Result<CampaignSpec> WithOverrides(CampaignSpec spec, const std::vector<std::string>& overrides) {
  OrderedJson json = ToJson(spec);
  for (const auto& text : overrides) ETUDE_RETURN_IF_ERROR(ApplyOverride(json, text));
  ETUDE_ASSIGN_OR_RETURN(spec, FromJson<CampaignSpec>(json, "--set"));
  ETUDE_ASSIGN_OR_RETURN(spec.objects, ExpandObjects(spec.objects));
  ETUDE_RETURN_IF_ERROR(spec.Validate());
  return spec;
}

std::string ProgressLine(const CollectorProgress& progress) {
  std::string line =
      fmt::format("{}/{} episodes  {:.1f}/min  expert {:.1f} %  {} workers", progress.committed, progress.total,
                  progress.episodes_per_minute, SuccessPercent(progress), progress.workers);
  if (progress.eta_s > 0) line += "  ETA " + FormatDuration(progress.eta_s);
  if (progress.reweighted > 0) line += fmt::format("  weights from {}", progress.reweighted_from);
  if (progress.given_up > 0) line += fmt::format("  given up {}", progress.given_up);
  if (!progress.failures.empty()) line += "  failed: " + FailureText(progress);
  if (!progress.error.empty()) line += "  WAITING: " + progress.error;
  return line;
}

std::string SummaryText(const CollectorProgress& progress) {
  std::string text;
  const auto row = [&](const char* name, const std::string& value) {
    text += fmt::format("  {:<18} {}\n", name, value);
  };
  row("episodes", fmt::format("{} of {}{}", progress.committed, progress.total,
                              progress.given_up ? fmt::format(", {} given up", progress.given_up) : ""));
  row("attempts", fmt::format("{} ({:.1f} % successful)", progress.attempts, SuccessPercent(progress)));
  if (!progress.failures.empty()) row("failures", FailureText(progress));
  if (progress.reweighted)
    row("sampling weights", fmt::format("changed {} times, the last time from episode {} on", progress.reweighted,
                                        progress.reweighted_from));
  if (progress.refused_errors) row("foreign errors", fmt::format("{} refused", progress.refused_errors));
  if (progress.lost_leases) row("leases lost", fmt::format("{} (workers died or fell silent)", progress.lost_leases));
  if (progress.stale_results) row("late results", fmt::format("{} refused", progress.stale_results));
  if (progress.duplicates) row("duplicates", fmt::format("{} recognised", progress.duplicates));
  if (progress.rechecked || progress.mismatched)
    row("made again", fmt::format("{} on another host, {} with other bytes", progress.rechecked, progress.mismatched));
  if (progress.refused) row("unfit episodes", fmt::format("{} refused", progress.refused));
  row("elapsed", FormatDuration(progress.elapsed_s));
  text.pop_back();
  return text;
}

}  // namespace etude::campaign
