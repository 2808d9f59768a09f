// SPDX-License-Identifier: Apache-2.0
#include "services/cli/filmstrip.h"

#include <fmt/format.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "services/codec/frame.h"
#include "services/episode/action.h"
#include "services/store/dataset.h"

namespace etude::cli {
namespace {

constexpr int kCaption = 24;  // px below each row
constexpr int kGap = 2;       // px between frames
constexpr int kJpegQuality = 85;

Result<cv::Mat> Row(const Episode& episode, int columns) {
  const CameraTrack& track = episode.cameras[0];
  const int width = track.camera.width, height = track.camera.height;
  cv::Mat row(height + kCaption, columns * (width + kGap) - kGap, CV_8UC3, cv::Scalar(24, 24, 24));
  std::vector<std::uint8_t> rgb(static_cast<std::size_t>(width) * height * 3);
  const std::size_t last = track.frames.size() - 1;
  for (int column = 0; column < columns; ++column) {
    const std::size_t k = columns == 1 ? last : last * static_cast<std::size_t>(column) / (columns - 1);
    ETUDE_RETURN_IF_ERROR(codec::InflateFrame(track.frames[k], rgb));
    cv::Mat place = row(cv::Rect(column * (width + kGap), 0, width, height));
    cv::cvtColor(cv::Mat(height, width, CV_8UC3, rgb.data()), place, cv::COLOR_RGB2BGR);
  }
  const std::string text = fmt::format("{}: \"{}\"   {} {}, {}, {:.1f} s", episode.index, episode.instruction,
                                       episode.task, episode.target, episode.outcome, episode.steps() / kControlRate);
  cv::putText(row, text, {6, height + 16}, cv::FONT_HERSHEY_SIMPLEX, 0.42, cv::Scalar(230, 230, 230), 1, cv::LINE_AA);
  return row;
}

}  // namespace

Status WriteFilmstrips(const Path& dataset, const Path& picture, const FilmstripOptions& options) {
  if (options.episodes < 1 || options.frames < 1)
    return Fail(Code::kInvalidArgument, fmt::format("filmstrips: {} episodes of {} frames: both must be at least 1",
                                                    options.episodes, options.frames));
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto all, reader.List());
  const bool chosen = !options.indices.empty();
  std::vector<cv::Mat> rows;
  for (const std::uint64_t index : chosen ? options.indices : all) {
    if (!chosen && static_cast<int>(rows.size()) == options.episodes) break;
    ETUDE_ASSIGN_OR_RETURN(const Episode episode, reader.ReadWhole(index));
    if (episode.cameras.empty() || episode.cameras[0].frames.empty()) continue;
    ETUDE_ASSIGN_OR_RETURN(auto row, Row(episode, options.frames));
    rows.push_back(std::move(row));
  }
  if (rows.empty())
    return Fail(Code::kNotFound, fmt::format("filmstrips of '{}': no episode with pictures", dataset.string()));
  cv::Mat sheet;
  cv::vconcat(rows, sheet);
  std::vector<std::uint8_t> bytes;
  const char* kind = picture.extension() == ".jpg" ? ".jpg" : ".png";
  if (!cv::imencode(kind, sheet, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality}))
    return Fail(Code::kInternal, "filmstrips: encoding failed");
  return WriteFileAtomically(picture, bytes);
}

}  // namespace etude::cli
