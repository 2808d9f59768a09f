// SPDX-License-Identifier: Apache-2.0
#include "services/store/plain_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>
#include <map>
#include <span>

#include "services/core/descriptor.h"
#include "services/store/edit.h"
#include "services/store/episode_file.h"
#include "services/store/filter_keys.h"
#include "services/store/hdf.h"
#include "services/store/master_file.h"
#include "services/store/summary.h"

namespace etude::store {
namespace {

using internal::HdfWriter;

// libhdf5 1.10 ends the program where a copy cannot be written (H5Ocopy, H5T_close_real): the room is taken before.
// What of it is not needed goes when the file is closed. Where a file system cannot do that, it is left to chance.
Status TakeRoom(const Path& path, std::uint64_t bytes) {
  const Descriptor file(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
  struct stat info {};
  if (file.get() < 0 || ::fstat(file.get(), &info) != 0) return Fail(ErrnoError("open", path, errno));
  if (::fallocate(file.get(), 0, info.st_size, static_cast<off_t>(bytes)) == 0 || errno == EOPNOTSUPP) return {};
  return Fail(ErrnoError(fmt::format("take {} KiB more in", bytes >> 10), path, errno));
}

class PlainFile {
 public:
  PlainFile(const DatasetReader& reader, const FilterKeys& keys, Path path)
      : reader_(reader), keys_(keys), path_(std::move(path)) {}

  Status Create() {
    HdfWriter file(path_, HdfWriter::OnDisk::kNew);
    file.Group("/data");
    return Done(file.Finish());
  }

  // Opened and closed for each, for HDF5 is locked as long as a writer lives.
  Status Add(std::uint64_t index) {
    const Path path = EpisodePath(reader_.path(), index);
    const auto context = [&] { return fmt::format("export '{}'", path.string()); };
    ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path, internal::kMaxEpisodeFile));
    auto decoded = internal::DecodeEpisodeFile(bytes);
    if (!decoded) return Fail(decoded.error().Wrap(context()));
    EpisodeRecord record{path, decoded->episode, decoded->frames};
    // HDF5's library gets bytes of our own making only
    const auto anew = internal::EncodeEpisodeFile(internal::WithStreams(std::move(*decoded), bytes));
    if (!anew) return Fail(Error{Code::kCorrupt, anew.error().message}.Wrap(context()));
    constexpr std::uint64_t kMore = 1 << 20;  // that the file's own tables may grow by
    ETUDE_RETURN_IF_ERROR(TakeRoom(path_, anew->size() + kMore));
    HdfWriter file(path_, HdfWriter::OnDisk::kAdd);
    file.CopyFrom(std::span(*anew).first(anew->size() - internal::kSealSize), internal::DemoGroup(index));
    if (Status copied = Done(file.Finish()); !copied) return Fail(copied.error().Wrap(context()));
    Remember(record);
    return {};
  }

  Status Finish(PlainFileReport& report) {
    HdfWriter file(path_, HdfWriter::OnDisk::kAdd);
    for (const auto& [index, summary] : summaries_) report.samples += summary.samples;
    file.Attribute("/data", "total", static_cast<std::int64_t>(report.samples));
    file.Attribute("/data", "env_args", internal::EnvArgs());
    file.Attribute("/data", "spec_sha256", reader_.spec_sha256());
    for (const auto& [name, demos] : internal::MasksOf(reader_.spec(), internal::EntriesOf(summaries_), keys_))
      file.FixedStrings("/mask/" + name, demos);
    std::size_t n = 0;
    for (const auto& [sentence, demos] : sentences_) {
      const std::string mask = "/mask/" + internal::LanguageMask(n++);
      file.FixedStrings(mask, demos);
      file.Attribute(mask, "lang", sentence);
    }
    report.episodes = summaries_.size();
    report.sentences = sentences_.size();
    return Done(file.Finish());
  }

  // robomimic's train.data: [{"path", "filter_key", "lang"}, ...]
  OrderedJson TrainData(const Path& out) const {
    OrderedJson data = OrderedJson::array();
    std::size_t n = 0;
    for (const auto& [sentence, demos] : sentences_)
      data.push_back({{"path", out.string()}, {"filter_key", internal::LanguageMask(n++)}, {"lang", sentence}});
    return data;
  }

 private:
  static Status Done(const Result<std::vector<std::uint8_t>>& finished) {
    if (!finished) return Fail(finished.error());
    return {};
  }

  void Remember(const EpisodeRecord& record) {
    const std::uint64_t index = record.episode.index;
    summaries_[index] = internal::Summarize(record);
    if (SplitOf(reader_.spec(), index) != "train") return;
    sentences_[record.episode.instruction].push_back(internal::DemoName(index));
  }

  const DatasetReader& reader_;
  const FilterKeys& keys_;
  Path path_;
  std::map<std::uint64_t, internal::EpisodeSummary> summaries_;
  std::map<std::string, std::vector<std::string>> sentences_;  // of the training split -> demos
};

}  // namespace

Result<PlainFileReport> WritePlainFile(const Path& dataset, const Path& out, const PlainFileOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, DatasetReader::Open(dataset));
  auto indices = options.indices;
  if (indices.empty()) {
    ETUDE_ASSIGN_OR_RETURN(indices, reader.List());
  }
  if (indices.empty())
    return Fail(Code::kNotFound, fmt::format("export '{}': it has no episodes yet", dataset.string()));
  ETUDE_ASSIGN_OR_RETURN(const FilterKeys keys, ReadFilterKeys(dataset));
  for (const auto& [name, chosen] : keys)
    if (internal::IsLanguageMask(name))
      return Fail(Code::kInvalidArgument,
                  fmt::format("export '{}': its filter key '{}' has a name that the file's sentences have; remove it "
                              "(etude dataset filter --remove-key {})",
                              dataset.string(), name, name));
  PlainFileReport report;
  report.train_data = out.string() + ".train_data.json";
  if (std::error_code error; std::filesystem::exists(report.train_data, error))
    return Fail(
        Code::kInvalidArgument,
        fmt::format("export '{}': '{}' is there already: it goes with the file; choose another name, or remove it",
                    dataset.string(), report.train_data.string()));
  ETUDE_ASSIGN_OR_RETURN(const Path partial, ClaimOutput(out, Made::kFile, options.leftover));
  PlainFile file(reader, keys, partial);
  ETUDE_RETURN_IF_ERROR(file.Create());
  for (std::size_t i = 0; i < indices.size(); ++i) {
    ETUDE_RETURN_IF_ERROR(internal::CheckNotStopped(i, indices.size(), partial));
    ETUDE_RETURN_IF_ERROR(file.Add(indices[i]));
    if (options.progress) options.progress(i + 1, indices.size());
  }
  ETUDE_RETURN_IF_ERROR(file.Finish(report));
  ETUDE_RETURN_IF_ERROR(SyncFile(partial));
  ETUDE_RETURN_IF_ERROR(CommitOutput(partial, out));
  const std::string train_data = JsonText(file.TrainData(out), 2);
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(report.train_data, train_data + "\n"));
  return report;
}

}  // namespace etude::store
