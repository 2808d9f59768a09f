// SPDX-License-Identifier: Apache-2.0
#include "services/store/sampling_journal.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <sstream>

#include "services/episode/bounded_json.h"
#include "services/store/layout.h"

namespace etude::store {
namespace {

constexpr std::uint64_t kMostBytes = 64u << 20;
constexpr int kDeepestEntry = 6;  // levels of JSON

Result<SamplingEntry> ParseEntry(const std::string& line) {
  const auto json = ParseBoundedJson(line, kDeepestEntry);
  if (!json) return Fail(Code::kCorrupt, "not JSON");
  return FromJson<SamplingEntry>(*json, "entry");
}

}  // namespace

Result<SamplingJournal> SamplingJournal::Open(const Path& folder, const CampaignSpec& spec) {
  SamplingJournal journal(folder / internal::kSampling, spec);
  ETUDE_ASSIGN_OR_RETURN(const auto text, ReadTextFileIfThere(journal.file_, kMostBytes));
  if (!text) return journal;
  std::istringstream lines(*text);
  for (std::string line; std::getline(lines, line);) {
    const auto wrong = [&](const Error& error) {
      return Fail(Code::kCorrupt, fmt::format("read '{}', line {}: {}; it says what the episodes were made with: put "
                                              "back the file that they came with",
                                              journal.file_.string(), journal.entries_.size() + 1, error.message));
    };
    auto entry = ParseEntry(line);
    if (!entry) return wrong(entry.error());
    if (const Status fits = journal.Check(*entry); !fits) return wrong(fits.error());
    journal.entries_.push_back(std::move(*entry));
  }
  return journal;
}

Status SamplingJournal::Check(const SamplingEntry& entry) const {
  ETUDE_RETURN_IF_ERROR(CheckWeights(entry.weights, spec_));
  if (entry.from_index >= next_from()) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("sampling weights: from episode {}, before {}", entry.from_index, next_from()));
}

const SamplingEntry* SamplingJournal::EntryAt(std::uint64_t index) const {
  const auto after = std::ranges::upper_bound(entries_, index, {}, &SamplingEntry::from_index);
  return after == entries_.begin() ? nullptr : &*std::prev(after);
}

const SamplingWeights& SamplingJournal::At(std::uint64_t index) const {
  static const SamplingWeights none;
  const SamplingEntry* const entry = EntryAt(index);
  return entry ? entry->weights : none;
}

std::uint64_t SamplingJournal::next_from() const {
  if (entries_.size() >= kMostEntries) return std::numeric_limits<std::uint64_t>::max();
  return (entries_.empty() ? 0 : entries_.back().from_index) + spec_.adaptive_sampling.every;
}

Status SamplingJournal::Append(const SamplingEntry& entry) {
  ETUDE_RETURN_IF_ERROR(Check(entry));
  // the whole file by rename: a crash leaves no part of a line, and what failed before is replaced
  std::string text;
  for (const SamplingEntry& earlier : entries_) text += ToJson(earlier).dump() + "\n";
  text += ToJson(entry).dump() + "\n";
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(file_, text));
  entries_.push_back(entry);
  return {};
}

}  // namespace etude::store
