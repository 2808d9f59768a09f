// SPDX-License-Identifier: Apache-2.0
#include "trainer/publish/sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <regex>

#include "services/core/disk_wait.h"
#include "services/core/free_name.h"
#include "services/core/hash.h"
#include "services/core/link.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::publish {
namespace {

namespace fs = std::filesystem;

using checkpoint::kBest;
using checkpoint::kLatest;
using checkpoint::LinkOf;

// Beside the id, so that it lives as long: whoever frees the disk of old checkpoints does not make new ones look old.
Path StartsFile(const Path& run_folder) { return run_folder / "starts"; }

std::uint64_t StartsIn(const Path& file) {
  std::uint64_t starts = 0;
  if (const auto text = ReadTextFile(file, 64)) std::from_chars(text->data(), text->data() + text->size(), starts);
  return starts;
}

// What WriteFileAtomically and PointLink of a killed process left of a run's files; the one trainer of the folder is
// this one. Other files there are the user's.
void RemoveHalfWritten(const Path& folder) {
  static const std::regex kHalf(
      R"((config\.yaml|training_state\.safetensors|name|starts|identity\.json|[a-z0-9]+\.safetensors)\.tmp-\d+-[0-9a-f]{8})");
  std::error_code error;
  std::vector<Path> found;
  for (const auto& item : fs::directory_iterator(folder, error))
    if (std::regex_match(item.path().filename().string(), kHalf)) found.push_back(item.path());
  for (const auto& path : found)
    if (fs::remove(path, error)) Log().info("removed '{}', left half written by a killed run", path.string());
}

}  // namespace

std::uint64_t NextStart(const Path& run_folder) {
  // where they were counted until this version
  const Path before = run_folder / "checkpoints" / "starts";
  return std::max(StartsIn(StartsFile(run_folder)), StartsIn(before)) + 1;
}

Status SetCheckpointsAside(const Path& run_folder, const Path& from) {
  const Path folder = run_folder / "checkpoints";
  std::error_code error;
  if (!from.empty() && fs::weakly_canonical(from, error).parent_path() == fs::weakly_canonical(folder, error))
    return Fail(Code::kInvalidArgument,
                fmt::format("init.from '{}' lies in the folder of checkpoints that the run in '{}' would write: give "
                            "another --out",
                            from.string(), run_folder.string()));
  bool any = false;
  for (const auto& item : fs::directory_iterator(folder, error)) any |= item.path().extension() == ".safetensors";
  if (!any) return {};
  const Path aside = FirstFree([&](int i) -> Path { return fmt::format("{}.before-{}", folder.string(), i); });
  fs::rename(folder, aside, error);
  if (error)
    return Fail(Code::kUnavailable,
                fmt::format("move '{}' aside to '{}': {}", folder.string(), aside.string(), error.message()));
  Log().warn("'{}' has checkpoints of a run whose state is gone: they are in '{}' now", run_folder.string(),
             aside.string());
  return {};
}

Result<CheckpointSink> CheckpointSink::Open(const Path& run_folder, const RunIdentity& run,
                                            const bus::Participant* participant, int keep,
                                            const std::function<void()>& waiting) {
  CheckpointSink sink;
  sink.keep_ = keep;
  sink.folder_ = run_folder / "checkpoints";
  sink.run_ = run;
  ETUDE_RETURN_IF_ERROR(MakeFolders(sink.folder_));
  RemoveHalfWritten(sink.folder_);
  RemoveHalfWritten(run_folder);
  // who is started on a full disk waits for it, as who trains does
  ETUDE_RETURN_IF_ERROR(CheckMayWrite(run_folder));
  ETUDE_RETURN_IF_ERROR(WriteWhenThereIsRoom(
      "the count of the run's starts",
      [&] { return WriteFileAtomically(StartsFile(run_folder), std::to_string(run.start)); }, std::chrono::seconds(1),
      waiting));
  std::error_code none;
  sink.best_ = fs::read_symlink(LinkOf(sink.folder_, kBest), none);
  if (participant) {
    ETUDE_ASSIGN_OR_RETURN(auto publisher, bus::BlobPublisher::Open(*participant, {run.name, run.id}));
    sink.publisher_ = std::make_unique<bus::BlobPublisher>(std::move(publisher));
    sink.PublishExisting();
  }
  return sink;
}

void CheckpointSink::PublishExisting() {
  for (const char* channel : {kBest, kLatest}) PublishNamed(channel);
}

void CheckpointSink::PublishNamed(const std::string& channel) {
  const auto bytes = ReadBinaryFile(LinkOf(folder_, channel));
  if (!bytes) return;
  const auto made = checkpoint::Decode(*bytes);
  if (made)
    Publish(channel, *bytes, made->metadata);
  else
    Log().warn("not published: {}: {}", LinkOf(folder_, channel).string(), made.error().message);
}

// `etude checkpoint promote` points `best` elsewhere while this run is under way.
void CheckpointSink::PublishPromoted() {
  std::error_code error;
  const Path now = fs::read_symlink(LinkOf(folder_, kBest), error);
  if (error || now == best_) return;
  best_ = now;
  Log().info("run={}: '{}' was promoted to channel {}", run_.name, now.string(), kBest);
  PublishNamed(kBest);
}

void CheckpointSink::Publish(const std::string& channel, std::span<const std::uint8_t> bytes,
                             const checkpoint::Metadata& metadata) {
  if (!publisher_) return;
  const std::uint64_t version = run_.start << 32 | ++published_;
  std::string summary = checkpoint::Summary(metadata).dump();
  if (run_.signer) {
    auto is_signed = run_.signer->Sign({run_.id, channel, version, Sha256Hex(bytes)}, summary);
    if (!is_signed)
      return Log().warn("not published: run={} channel={}: {}", run_.name, channel, is_signed.error().message);
    summary = std::move(*is_signed);
  }
  const Status sent = publisher_->Publish(channel, version, bytes, summary);
  if (!sent) Log().warn("publish checkpoint run={} channel={}: {}", run_.name, channel, sent.error().message);
}

Result<Kept> CheckpointSink::Save(const checkpoint::Checkpoint& made) {
  checkpoint::Checkpoint named = made;  // tensors are handles
  named.metadata.run = run_.name;
  const checkpoint::Metadata& metadata = named.metadata;
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, checkpoint::Encode(named));
  const Path name = checkpoint::FileNameOf(metadata.step);
  PublishPromoted();
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder_ / name, bytes));
  ETUDE_RETURN_IF_ERROR(PointLink(LinkOf(folder_, kLatest), name));
  if (metadata.best) {
    ETUDE_RETURN_IF_ERROR(PointLink(LinkOf(folder_, kBest), name));
    best_ = name;
  }
  Publish(kLatest, bytes, metadata);
  if (metadata.best) Publish(kBest, bytes, metadata);
  ETUDE_RETURN_IF_ERROR(Prune());
  Kept kept{name.string(), Sha256Hex(bytes), {kLatest}};
  if (metadata.best) kept.channels.push_back(kBest);
  return kept;
}

bool CheckpointSink::Has(std::uint64_t step) const {
  std::error_code error;
  return fs::exists(folder_ / checkpoint::FileNameOf(step), error);
}

bool CheckpointSink::HasBest() const {
  std::error_code error;
  return fs::exists(LinkOf(folder_, kBest), error);  // the file, not the link
}

void CheckpointSink::AwaitSubscribers() {
  constexpr std::chrono::seconds kPatience{30};
  if (publisher_ && !publisher_->AwaitTaken(StopRequested() ? std::chrono::seconds(3) : kPatience))
    Log().warn("not everybody who follows run={} has its last checkpoint; it is in '{}'", run_.name, folder_.string());
}

Status CheckpointSink::Prune() const {
  std::error_code error;
  const Path best = fs::read_symlink(LinkOf(folder_, kBest), error).filename();  // somebody may have made it a path
  const Path latest = fs::read_symlink(LinkOf(folder_, kLatest), error).filename();
  std::vector<Path> files;
  for (const auto& item : fs::directory_iterator(folder_, error)) {
    const Path name = item.path().filename();
    if (!item.is_symlink(error) && checkpoint::IsFileName(name) && name != best && name != latest)
      files.push_back(item.path());
  }
  // `latest` is one of those kept
  std::sort(files.begin(), files.end());
  for (std::size_t i = 0; i + static_cast<std::size_t>(keep_) - 1 < files.size(); ++i) fs::remove(files[i], error);
  return {};
}

}  // namespace etude::publish
