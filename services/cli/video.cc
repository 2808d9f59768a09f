// SPDX-License-Identifier: Apache-2.0
#include "services/cli/video.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "services/cli/file_names.h"
#include "services/codec/frame.h"
#include "services/episode/action.h"
#include "services/store/dataset.h"

namespace etude::cli {
namespace {

constexpr int kScale = 2;
constexpr int kCaption = 44;  // px below the picture

struct Candidate {
  std::uint64_t index = 0;
  bool success = false;
  std::string name;
};

Result<std::vector<Candidate>> Candidates(const store::DatasetReader& reader) {
  std::vector<Candidate> candidates;
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  for (const std::uint64_t index : indices) {
    ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
    const Episode& episode = record.episode;
    if (record.frames.empty() || record.frames[0].empty()) continue;
    candidates.push_back({index, episode.success, VideoFileName(index, episode.task, episode.outcome)});
  }
  std::stable_partition(candidates.begin(), candidates.end(), [](const auto& item) { return !item.success; });
  return candidates;
}

Result<cv::VideoWriter> OpenWriter(const Path& path, double fps, cv::Size size) {
  for (const char* code : {"avc1", "mp4v"}) {
    cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]),
                           fps, size);
    if (writer.isOpened()) return writer;
  }
  return Fail(Code::kUnavailable,
              fmt::format("write the video '{}': OpenCV has neither an H.264 nor an MPEG-4 encoder; install "
                          "libopencv-dev and libavcodec-dev",
                          path.string()));
}

void Caption(cv::Mat& picture, const std::string& first, const std::string& second) {
  const int top = picture.rows - kCaption;
  picture.rowRange(top, picture.rows).setTo(cv::Scalar(24, 24, 24));
  const auto put = [&](const std::string& text, int y, double value) {
    cv::putText(picture, text, {8, y}, cv::FONT_HERSHEY_SIMPLEX, 0.45, cv::Scalar(value, value, value), 1, cv::LINE_AA);
  };
  put(first, top + 17, 255);
  put(second, top + 36, 170);
}

Status WriteVideo(const Episode& episode, const Path& path) {
  const CameraTrack& track = episode.cameras[0];
  const int width = track.camera.width, height = track.camera.height;
  const double fps = kControlRate / episode.image_stride;
  const Path temporary = path.parent_path() / ("." + path.filename().string());
  const cv::Size size(width * kScale, height * kScale + kCaption);
  {
    ETUDE_ASSIGN_OR_RETURN(auto writer, OpenWriter(temporary, fps, size));
    std::vector<std::uint8_t> rgb(static_cast<std::size_t>(width) * height * 3);
    cv::Mat picture(size, CV_8UC3), bgr, large;
    for (std::size_t k = 0; k < track.frames.size(); ++k) {
      ETUDE_RETURN_IF_ERROR(codec::InflateFrame(track.frames[k], rgb));
      cv::cvtColor(cv::Mat(height, width, CV_8UC3, rgb.data()), bgr, cv::COLOR_RGB2BGR);
      cv::resize(bgr, large, {}, kScale, kScale, cv::INTER_CUBIC);
      large.copyTo(picture.rowRange(0, height * kScale));
      const double seconds = static_cast<double>(k) / fps;
      Caption(picture, "\"" + episode.instruction + "\"",
              fmt::format("{:5.2f} s   {} {}   {}", seconds, episode.task, episode.target, episode.outcome));
      writer.write(picture);
    }
  }
  std::error_code error;
  std::filesystem::rename(temporary, path, error);
  if (error) return Fail(Code::kUnavailable, fmt::format("write the video '{}': {}", path.string(), error.message()));
  return {};
}

}  // namespace

Result<std::vector<Path>> WriteVideos(const Path& rollouts, const Path& folder, int limit) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(rollouts));
  ETUDE_ASSIGN_OR_RETURN(auto candidates, Candidates(reader));
  candidates.resize(std::min(candidates.size(), static_cast<std::size_t>(std::max(limit, 0))));
  if (candidates.empty()) return std::vector<Path>{};
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  std::vector<Path> videos;
  for (const auto& candidate : candidates) {
    const Path path = folder / candidate.name;
    videos.push_back(path);
    if (std::filesystem::exists(path)) continue;
    ETUDE_ASSIGN_OR_RETURN(const Episode episode, reader.ReadWhole(candidate.index));
    try {
      ETUDE_RETURN_IF_ERROR(WriteVideo(episode, path));
    } catch (const cv::Exception& error) {
      return Fail(Code::kInternal, fmt::format("write the video '{}': {}", path.string(), error.what()));
    }
  }
  return videos;
}

}  // namespace etude::cli
