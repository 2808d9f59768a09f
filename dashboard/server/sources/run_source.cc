// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/run_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "services/core/file.h"
#include "services/core/hash.h"
#include "services/core/identity.h"
#include "services/store/safetensors.h"

namespace etude::sources {
namespace {

constexpr std::chrono::milliseconds kRunRefreshEvery{500};
constexpr std::size_t kMostSeries = 500;        // of a run
constexpr std::size_t kMostPoints = 2'000'000;  // of a series
constexpr std::size_t kRecentLines = 64;
constexpr std::size_t kMostCheckpoints = 500;  // whose headers are read: the newest
constexpr std::size_t kMostNames = 100'000;    // of files in the folder
constexpr std::string_view kEnding = ".safetensors";

// "modules.LANG.attention.key_weight" -> "LANG", "image.norm.bias" -> "image"
std::string PartOfTensor(std::string_view name) {
  constexpr std::string_view kModules = "modules.";
  if (name.starts_with(kModules)) name.remove_prefix(kModules.size());
  return std::string(name.substr(0, name.find('.')));
}

std::uint64_t Numbers(const OrderedJson& tensor) {
  std::uint64_t numbers = 1;
  for (const auto& extent : PartOf(tensor, "shape")) {
    const auto size = extent.is_number_unsigned() ? extent.get<std::uint64_t>() : 0;
    if (size != 0 && numbers > (1ull << 53) / size) return 0;  // no file of ours
    numbers *= size;
  }
  return numbers;
}

}  // namespace

std::optional<double> MetricsTable::Last(const std::string& key) const {
  const auto found = series_.find(key);
  if (found == series_.end() || found->second.value.empty()) return std::nullopt;
  const double value = found->second.value.back();
  return std::isfinite(value) ? std::optional<double>(value) : std::nullopt;
}

std::vector<OrderedJson> MetricsTable::LinesAfter(std::uint64_t step, std::size_t most) const {
  std::vector<OrderedJson> lines;
  for (const auto& line : recent_)
    if (UnsignedOf(line, "step").value_or(0) > step) lines.push_back(line);
  if (lines.size() > most) lines.erase(lines.begin(), lines.end() - static_cast<std::ptrdiff_t>(most));
  return lines;
}

void MetricsTable::Resume(std::uint64_t step) {
  std::erase_if(recent_, [&](const auto& line) { return UnsignedOf(line, "step").value_or(0) >= step; });
  for (auto& [key, series] : series_) {
    const auto from = std::lower_bound(series.step.begin(), series.step.end(), static_cast<double>(step));
    const auto keep = static_cast<std::size_t>(from - series.step.begin());
    for (std::size_t i = keep; i < series.value.size(); ++i) series.nulls -= std::isfinite(series.value[i]) ? 0 : 1;
    for (auto* column : {&series.step, &series.time, &series.elapsed, &series.value}) column->resize(keep);
  }
}

void MetricsTable::Take(const OrderedJson& line) {
  const std::string kind = TextOf(line, "kind");
  const auto step = UnsignedOf(line, "step");
  const auto time = NumberOf(line, "time");
  if (kind == "end") {
    end_ = RunEnd{TextOf(line, "cause", "stopped"), step, time};
    return;
  }
  if ((kind != "train" && kind != "valid") || !step) return;
  if (lives_.empty() || *step < step_) {
    if (!lives_.empty()) Resume(*step);
    lives_.push_back({*step, time});
  }
  end_.reset();
  step_ = *step;
  recent_.push_back(line);
  if (recent_.size() > kRecentLines) recent_.erase(recent_.begin());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double elapsed = NumberOf(line, "elapsed_s").value_or(nan);
  for (const auto& [name, value] : line.items()) {
    if (name == "kind" || name == "step" || name == "time" || name == "elapsed_s") continue;
    if (!value.is_number() && !value.is_null()) continue;
    const std::string key = kind + "/" + name;
    if (!series_.contains(key) && series_.size() >= kMostSeries) continue;
    Series& series = series_[key];
    if (series.value.size() >= kMostPoints) continue;
    const double number = value.is_null() ? nan : value.get<double>();
    series.step.push_back(static_cast<double>(*step));
    series.time.push_back(time.value_or(nan));
    series.elapsed.push_back(elapsed);
    series.value.push_back(number);
    series.nulls += std::isfinite(number) ? 0 : 1;
  }
}

namespace {

constexpr std::size_t kNoEntry = SIZE_MAX;

// The entries of the bucket that is being filled, which are the last ones.
class Filling {
 public:
  explicit Filling(Buckets& buckets) : buckets_(buckets) {}

  void Begin() { number_ = gap_ = kNoEntry; }
  void Take(double x, double value, std::size_t index) {
    std::size_t& entry = std::isfinite(value) ? number_ : gap_;
    if (entry == kNoEntry) {
      entry = buckets_.x.size();
      for (auto* column : {&buckets_.x, &buckets_.min, &buckets_.max, &buckets_.last}) column->push_back(value);
      buckets_.index.push_back(index);
    } else if (entry + 1 < buckets_.x.size()) {
      Swap(entry);  // the newer one stands last: x ascends
    }
    const std::size_t at = buckets_.x.size() - 1;
    buckets_.x[at] = x;
    buckets_.min[at] = std::min(buckets_.min[at], value);
    buckets_.max[at] = std::max(buckets_.max[at], value);
    buckets_.last[at] = value;
    buckets_.index[at] = index;
  }

 private:
  void Swap(std::size_t entry) {
    for (auto* column : {&buckets_.x, &buckets_.min, &buckets_.max, &buckets_.last})
      std::swap((*column)[entry], column->back());
    std::swap(buckets_.index[entry], buckets_.index.back());
    std::swap(number_, gap_);
  }

  Buckets& buckets_;
  std::size_t number_ = kNoEntry, gap_ = kNoEntry;
};

}  // namespace

Buckets Bucketed(const std::vector<double>& x, const std::vector<double>& value, double from, double to,
                 std::size_t points) {
  std::vector<std::size_t> inside;
  for (std::size_t i = 0; i < x.size(); ++i)
    if (std::isfinite(x[i]) && x[i] >= from && x[i] <= to) inside.push_back(i);
  Buckets buckets;
  Filling filling(buckets);
  const auto take = [&](std::size_t i) {
    // an infinity is no number to draw, either
    filling.Take(x[i], std::isfinite(value[i]) ? value[i] : std::numeric_limits<double>::quiet_NaN(), i);
  };
  if (inside.size() <= points || points == 0) {
    for (const auto i : inside) filling.Begin(), take(i);
    return buckets;
  }
  const double low = x[inside.front()];
  double high = low;
  for (const auto i : inside) high = std::max(high, x[i]);
  const double width = high > low ? (high - low) / static_cast<double>(points) : 1;
  std::size_t current = points;  // none
  for (const auto i : inside) {
    const double place = std::max(0.0, (x[i] - low) / width);
    const auto bucket = std::min(points - 1, static_cast<std::size_t>(place));
    if (bucket != current) filling.Begin();
    current = bucket;
    take(i);
  }
  return buckets;
}

Result<CheckpointHeader> ReadCheckpointHeader(const Path& folder, const std::string& file, std::uint64_t header_bytes) {
  ETUDE_ASSIGN_OR_RETURN(const ConfinedFile open, OpenBelow(folder, file));
  CheckpointHeader header;
  header.file = file;
  header.stamp = open.stamp;
  const auto json = store::ReadSafetensorsHeader(open.file.get(), file, header_bytes);
  if (!json) {
    header.error = json.error().message;
    return header;
  }
  for (const auto& [name, tensor] : json->items()) {
    if (name != "__metadata__") {
      header.parameters[PartOfTensor(name)] += Numbers(tensor);
      continue;
    }
    for (const auto& [key, value] : tensor.items())
      if (value.is_string()) header.metadata[key] = value.get<std::string>();
  }
  return header;
}

RunSource::RunSource(Found found)
    : found_(std::move(found)),
      metrics_file_(found_.folder / "metrics.jsonl"),
      curriculum_file_(found_.folder / "curriculum.jsonl") {}

void RunSource::ReadCheckpoints() {
  const Path folder = found_.folder / "checkpoints";
  std::map<std::string, std::vector<std::string>> channels;  // file -> links to it
  std::vector<std::string> files;
  std::error_code error;
  std::filesystem::directory_iterator entries(folder, error), end;
  for (; !error && entries != end && files.size() < kMostNames; entries.increment(error)) {
    const std::string name = entries->path().filename().string();
    if (!name.ends_with(kEnding) || name.starts_with('.')) continue;
    std::error_code ignored;
    if (entries->is_symlink(ignored)) {
      // a channel: the link's own words, so that it can name a file beside it and nothing else
      const std::string target = std::filesystem::read_symlink(entries->path(), ignored).string();
      channels[target].push_back(name.substr(0, name.size() - kEnding.size()));
    } else {
      files.push_back(name);
    }
  }
  std::ranges::sort(files, std::greater<>());
  std::vector<std::string> older(files.begin() + static_cast<std::ptrdiff_t>(std::min(files.size(), kMostCheckpoints)),
                                 files.end());
  files.resize(files.size() - older.size());
  for (auto& file : older)
    if (channels.contains(file)) files.push_back(std::move(file));
  std::vector<CheckpointHeader> headers;
  for (const auto& file : files) {
    const auto known = std::ranges::find(now_.checkpoints, file, &CheckpointHeader::file);
    if (known != now_.checkpoints.end() && known->stamp == StampOf(folder / file)) {
      headers.push_back(*known);
    } else if (auto header = ReadCheckpointHeader(folder, file)) {
      headers.push_back(std::move(*header));
    } else {
      continue;
    }
    auto& header = headers.back();
    header.channels = channels.contains(file) ? channels[file] : std::vector<std::string>{};
    std::ranges::sort(header.channels);
    if (const auto hash = hashes_.find(header.stamp.tag()); hash != hashes_.end()) header.sha256 = hash->second;
  }
  changed_ = changed_ || headers != now_.checkpoints;
  now_.checkpoints = std::move(headers);
}

void RunSource::Refresh() {
  if (view_ && MonotonicClock::now() - refreshed_ < kRunRefreshEvery) return;
  refreshed_ = MonotonicClock::now();
  metrics_file_.Refresh([&] { now_.metrics.Clear(), changed_ = true; },
                        [&](const OrderedJson& line) { now_.metrics.Take(line), changed_ = true; });
  changed_ = changed_ || now_.torn != metrics_file_.torn();
  now_.torn = metrics_file_.torn();
  curriculum_file_.Refresh([&] { now_.curriculum.clear(), changed_ = true; },
                           [&](const OrderedJson& line) {
                             changed_ = true;
                             if (now_.curriculum.size() < 1000) now_.curriculum.push_back(line);
                           });
  if (const auto stamp = StampOf(found_.folder / "config.yaml"); stamp != config_stamp_) {
    config_stamp_ = stamp;
    changed_ = true;
    now_.config = nullptr;
    if (const auto text = ReadTextFile(found_.folder / "config.yaml", 1 << 20))
      if (auto config = ParseYaml(*text, "config.yaml")) now_.config = std::move(*config);
  }
  if (const auto identity = ReadIdentity(found_.folder); identity && identity->id != now_.identity) {
    now_.identity = identity->id;
    now_.since = identity->since;
    changed_ = true;
  }
  ReadCheckpoints();
  const double before = now_.updated;
  now_.updated =
      std::max({metrics_file_.stamp().modified_s(), curriculum_file_.stamp().modified_s(), config_stamp_.modified_s()});
  for (const auto& header : now_.checkpoints) now_.updated = std::max(now_.updated, header.stamp.modified_s());
  // the whole table is copied, which may be large
  if (view_ && !changed_ && now_.updated == before) return;
  view_ = std::make_shared<const RunView>(now_);
  changed_ = false;
}

Result<std::shared_ptr<const RunView>> RunSource::View() {
  MutexLock lock(mutex_);
  Refresh();
  return view_;
}

bool RunSource::HashNext() {
  std::string file;
  {
    MutexLock lock(mutex_);
    const auto next = std::ranges::find_if(
        now_.checkpoints, [](const auto& header) { return header.sha256.empty() && header.error.empty(); });
    if (next == now_.checkpoints.end()) return false;
    file = next->file;
  }
  const auto open = OpenBelow(found_.folder / "checkpoints", file);
  Sha256 hash;
  std::uint64_t hashed = 0;
  if (open) {
    std::vector<std::uint8_t> chunk(1 << 20);
    for (;;) {
      const std::size_t got = ReadAt(open->file.get(), file, hashed, chunk).value_or(0);
      if (got == 0) break;
      hash.Update(std::span<const std::uint8_t>(chunk.data(), got));
      hashed += got;
    }
  }
  MutexLock lock(mutex_);
  const auto header = std::ranges::find(now_.checkpoints, file, &CheckpointHeader::file);
  if (header == now_.checkpoints.end()) return true;
  if (!open) {
    header->error = open.error().message;
    return true;
  }
  if (hashed != open->stamp.size) {  // it cannot be read to its end, or is being written
    header->error = fmt::format("hash '{}': {} of its {} bytes were read", file, hashed, open->stamp.size);
    view_ = std::make_shared<const RunView>(now_);
    return true;
  }
  header->sha256 = ToHex(hash.Finish());
  if (hashes_.size() > 2 * kMostCheckpoints) hashes_.clear();
  hashes_[open->stamp.tag()] = header->sha256;
  view_ = std::make_shared<const RunView>(now_);
  return true;
}

}  // namespace etude::sources
