// SPDX-License-Identifier: Apache-2.0
// Campaign files as commands read them, and what commands say about a campaign.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/collector.h"
#include "services/spec/campaign_spec.h"

namespace etude::campaign {

struct SpecArguments {
  std::string file;  ///< YAML
  std::optional<std::uint64_t> episodes, seed;
  std::vector<std::string> overrides;  ///< "a.b=c"
};

/// File, then overrides, then --episodes and --seed; validated.
/// @error kInvalidArgument: no such file, or all its problems at once
Result<CampaignSpec> LoadSpec(const SpecArguments& arguments);
/// The same where `file` may be the folder of a dataset, whose spec it is then, with the overrides alone.
/// @error of the store, too
Result<CampaignSpec> LoadSpecOrDataset(const SpecArguments& arguments);
/// A spec that comes from elsewhere (a dataset, a command's own) with `overrides` ("a.b=c") over it; validated.
/// @error kInvalidArgument (all problems at once)
Result<CampaignSpec> WithOverrides(CampaignSpec spec, const std::vector<std::string>& overrides);

/// "120/400 episodes  31.2/min  expert 98.4 %  2 workers  ETA 9:05  failed: plan_failed 2".
std::string ProgressLine(const CollectorProgress& progress);
/// A small table for the end.
std::string SummaryText(const CollectorProgress& progress);

}  // namespace etude::campaign
