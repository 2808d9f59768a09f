// SPDX-License-Identifier: Apache-2.0
#include "trainer/publish/sink.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>

#include "services/core/log.h"
#include "trainer/publish/checkpoint.h"

namespace etude::publish {
namespace {

namespace fs = std::filesystem;

Path LinkPath(const Path& folder, const std::string& channel) { return folder / (channel + ".safetensors"); }

// replaces a link so that a reader sees the old one or the new one
Status PointTo(const Path& link, const Path& target) {
  const Path temporary = link.string() + ".new";
  std::error_code error;
  fs::remove(temporary, error);
  fs::create_symlink(target, temporary, error);
  if (!error) fs::rename(temporary, link, error);
  if (error) return Fail(ErrnoError("point", link, error.value()));
  return SyncFolder(link.parent_path());
}

// one more start of the run, counted on disk
Result<std::uint64_t> CountStart(const Path& file) {
  std::uint64_t starts = 0;
  if (const auto text = ReadTextFile(file, 64)) std::from_chars(text->data(), text->data() + text->size(), starts);
  ++starts;
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(file, std::to_string(starts)));
  return starts;
}

OrderedJson MetaOf(const CheckpointInfo& info) {
  return {{"run", info.run},         {"step", info.step},       {"stage", info.stage},
          {"stages", info.stages},   {"name", info.stage_name}, {"architecture", info.architecture},
          {"version", info.version}, {"metrics", info.metrics}};
}

}  // namespace

std::string RunNameOf(const Path& folder) {
  std::string name = fs::absolute(folder).lexically_normal().filename().string();
  if (name.empty()) name = fs::absolute(folder).lexically_normal().parent_path().filename().string();
  for (char& c : name) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_') c = '-';
  }
  name = name.substr(0, 64);
  return name.empty() ? "run" : name;
}

Result<CheckpointSink> CheckpointSink::Open(const Path& run_folder, const std::string& run_name,
                                            const bus::Participant* participant) {
  CheckpointSink sink;
  sink.folder_ = run_folder / "checkpoints";
  sink.run_ = run_name;
  ETUDE_RETURN_IF_ERROR(MakeFolders(sink.folder_));
  ETUDE_ASSIGN_OR_RETURN(sink.start_, CountStart(sink.folder_ / "starts"));
  if (participant) {
    ETUDE_ASSIGN_OR_RETURN(auto publisher, bus::ObjectPublisher::Open(*participant, run_name));
    sink.publisher_ = std::make_unique<bus::ObjectPublisher>(std::move(publisher));
    sink.PublishExisting();
  }
  return sink;
}

void CheckpointSink::PublishExisting() {
  for (const char* channel : {kBest, kLatest}) {
    const auto bytes = ReadBinaryFile(LinkPath(folder_, channel));
    if (!bytes) continue;
    const auto checkpoint = DecodeCheckpoint(*bytes);
    if (checkpoint)
      Publish(channel, *bytes, MetaOf(checkpoint->info));
    else
      Log().warn("not published: {}: {}", LinkPath(folder_, channel).string(), checkpoint.error().message);
  }
}

void CheckpointSink::Publish(const std::string& channel, std::span<const std::uint8_t> bytes, const OrderedJson& meta) {
  if (!publisher_) return;
  const std::uint64_t version = start_ << 32 | ++published_;
  const Status sent = publisher_->Publish(channel, version, bytes, meta.dump());
  if (!sent) Log().warn("publish checkpoint run={} channel={}: {}", run_, channel, sent.error().message);
}

Status CheckpointSink::Save(const learn::CheckpointRequest& request) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, EncodeCheckpoint(request, run_));
  const Path name = fmt::format("{:08}.safetensors", request.step);
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(folder_ / name, bytes));
  ETUDE_RETURN_IF_ERROR(PointTo(LinkPath(folder_, kLatest), name));
  if (request.best) ETUDE_RETURN_IF_ERROR(PointTo(LinkPath(folder_, kBest), name));

  const CheckpointInfo info{.run = run_,
                            .version = ETUDE_VERSION,
                            .stage_name = request.stage_name,
                            .dataset = request.dataset,
                            .architecture = policy::ArchitectureHash(request.config->policy),
                            .step = request.step,
                            .train_episodes = request.train_episodes,
                            .stage = request.stage,
                            .stages = request.stages,
                            .joints = request.joints,
                            .metrics = request.metrics,
                            .train_config = {}};
  Publish(kLatest, bytes, MetaOf(info));
  if (request.best) Publish(kBest, bytes, MetaOf(info));
  return Prune(request.config->checkpoint.keep);
}

Status CheckpointSink::Prune(int keep) const {
  std::error_code error;
  const Path best = fs::read_symlink(LinkPath(folder_, kBest), error);
  const Path latest = fs::read_symlink(LinkPath(folder_, kLatest), error);
  std::vector<Path> files;
  for (const auto& item : fs::directory_iterator(folder_, error)) {
    const Path& name = item.path().filename();
    if (!item.is_symlink(error) && name.extension() == ".safetensors" && name != best && name != latest)
      files.push_back(item.path());
  }
  // `latest` is one of those kept
  std::sort(files.begin(), files.end());
  for (std::size_t i = 0; i + static_cast<std::size_t>(keep) - 1 < files.size(); ++i) fs::remove(files[i], error);
  return {};
}

}  // namespace etude::publish
