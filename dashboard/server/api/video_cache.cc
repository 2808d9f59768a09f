// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/video_cache.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "dashboard/server/sources/bounded_folder.h"
#include "dashboard/server/sources/files.h"
#include "services/core/hash.h"
#include "services/episode/action.h"
#include "services/video/mp4_writer.h"
#include "services/video/picture.h"

namespace etude::api {
namespace {

constexpr int kScale = 2;  // 4:2:0 halves colours: every pixel twice keeps its own

Status Make(const store::EpisodeRecord& record, std::size_t camera, const Path& file) {
  const Camera& of = record.episode.cameras[camera].camera;
  ETUDE_ASSIGN_OR_RETURN(
      auto writer,
      video::Mp4Writer::Open(file, {.width = of.width * kScale,
                                    .height = of.height * kScale,
                                    .rate = {static_cast<int>(kControlRate), record.episode.image_stride}}));
  video::Picture picture{of.width, of.height, {}};
  store::FrameReader frames(record.path, record.frames[camera]);
  for (std::size_t k = 0; k < record.frames[camera].size(); ++k) {
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Read(k));
    picture.rgb.assign(rgb.begin(), rgb.end());
    ETUDE_RETURN_IF_ERROR(writer.Write(video::Enlarged(picture, kScale).rgb));
  }
  return writer.Finish();
}

}  // namespace

Result<Path> CachedVideo(const Path& folder, const store::EpisodeRecord& record, std::size_t camera,
                         std::uint64_t most_bytes) {
  if (camera >= record.frames.size() || record.frames[camera].empty())
    return Fail(Code::kNotFound, fmt::format("episode {} has no pictures", record.episode.index));
  const std::string key = sources::StampOf(record.path).tag() + record.path.string() + std::to_string(camera);
  const Path file = folder / (Sha256Hex(key).substr(0, 32) + ".mp4");
  std::error_code error;
  if (std::filesystem::exists(file, error)) {
    sources::MarkUsed(file);  // that decides which ones go
    return file;
  }
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  ETUDE_RETURN_IF_ERROR(Make(record, camera, file));
  sources::TrimFolder(folder, most_bytes, file, [](const Path& entry) { return entry.extension() == ".mp4"; });
  return file;
}

}  // namespace etude::api
