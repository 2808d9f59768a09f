// SPDX-License-Identifier: Apache-2.0
#include "services/cli/filmstrip.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "services/episode/action.h"
#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"
#include "services/video/mp4_writer.h"

namespace etude::cli {
namespace {

constexpr int kCaption = 24;  // px below each row
constexpr int kGap = 2;       // px between frames
constexpr int kJpegQuality = 85;

Result<cv::Mat> Row(const Episode& episode, int columns) {
  FrameCursor frames(episode);
  const Camera& camera = episode.cameras[0].camera;
  const int width = camera.width, height = camera.height;
  cv::Mat row(height + kCaption, columns * (width + kGap) - kGap, CV_8UC3, cv::Scalar(24, 24, 24));
  const std::size_t last = frames.size() - 1;
  for (int column = 0; column < columns; ++column) {
    const std::size_t k = columns == 1 ? last : last * static_cast<std::size_t>(column) / (columns - 1);
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames.Frame(k));
    cv::Mat place = row(cv::Rect(column * (width + kGap), 0, width, height));
    cv::cvtColor(cv::Mat(height, width, CV_8UC3, const_cast<std::uint8_t*>(rgb.data())), place, cv::COLOR_RGB2BGR);
  }
  const std::string text = fmt::format("{}: \"{}\"   {} {}, {}, {:.1f} s", episode.index, episode.instruction,
                                       episode.task, episode.target, episode.outcome, episode.steps() / kControlRate);
  cv::putText(row, text, {6, height + 16}, cv::FONT_HERSHEY_SIMPLEX, 0.42, cv::Scalar(230, 230, 230), 1, cv::LINE_AA);
  return row;
}

// An episode's tile of a moving picture: the last picture stays when it is over. The episode is borrowed.
class Tile {
 public:
  Tile(const Episode& episode, cv::Mat place)
      : camera_(episode.cameras[0].camera), frames_(episode), place_(std::move(place)) {
    const cv::Mat below = place_.rowRange(place_.rows - kCaption, place_.rows);
    cv::putText(below, episode.instruction, {5, 16}, cv::FONT_HERSHEY_SIMPLEX, 0.38, cv::Scalar(230, 230, 230), 1,
                cv::LINE_AA);
  }
  std::size_t pictures() const { return frames_.size(); }
  Status Show(std::size_t k) {
    if (k >= frames_.size()) return {};
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames_.Frame(k));
    const cv::Mat picture(camera_.height, camera_.width, CV_8UC3, const_cast<std::uint8_t*>(rgb.data()));
    cv::resize(picture, place_.rowRange(0, place_.rows - kCaption), {place_.cols, place_.rows - kCaption}, 0, 0,
               cv::INTER_AREA);
    return {};
  }

 private:
  const Camera& camera_;
  FrameCursor frames_;
  cv::Mat place_;
};

// All of them side by side, RGB, from their first picture to the end of the longest.
Status WriteMoving(const std::vector<Episode>& episodes, const Path& file) {
  const Camera& camera = episodes[0].cameras[0].camera;
  const int width = camera.width / 2 * 2, height = camera.height / 2 * 2 + kCaption;  // H.264 and WebP halve colours
  const int columns = static_cast<int>(episodes.size());
  const video::FrameRate rate{static_cast<int>(kControlRate), episodes[0].image_stride};
  cv::Mat canvas(height, columns * width, CV_8UC3, cv::Scalar(24, 24, 24));
  std::vector<Tile> tiles;
  std::size_t pictures = 0;
  for (const auto& episode : episodes) {
    const int left = static_cast<int>(tiles.size()) * width;
    tiles.emplace_back(episode, canvas(cv::Rect(left, 0, width, height)));
    pictures = std::max(pictures, tiles.back().pictures());
  }
  video::Mp4Options options{.width = canvas.cols, .height = canvas.rows, .rate = rate};
  ETUDE_RETURN_IF_ERROR(MakeFolders(file.parent_path()));
  if (file.extension() == ".webp") options.container = video::Container::kAnimatedWebp;
  ETUDE_ASSIGN_OR_RETURN(auto writer, video::Mp4Writer::Open(file, options));
  for (std::size_t k = 0; k < pictures; ++k) {
    for (auto& tile : tiles) {
      ETUDE_RETURN_IF_ERROR(tile.Show(k));
    }
    ETUDE_RETURN_IF_ERROR(writer.Write({canvas.data, canvas.total() * canvas.elemSize()}));
  }
  return writer.Finish();
}

}  // namespace

Status WriteFilmstrips(const Path& dataset, const Path& picture, const FilmstripOptions& options) {
  if (options.episodes < 1 || options.frames < 1)
    return Fail(Code::kInvalidArgument, fmt::format("filmstrips: {} episodes of {} frames: both must be at least 1",
                                                    options.episodes, options.frames));
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(dataset));
  ETUDE_ASSIGN_OR_RETURN(const auto all, reader.List());
  const bool chosen = !options.indices.empty();
  const bool moving = picture.extension() == ".webp" || picture.extension() == ".mp4";
  std::vector<cv::Mat> rows;
  std::vector<Episode> episodes;
  for (const std::uint64_t index : chosen ? options.indices : all) {
    if (!chosen && static_cast<int>(rows.size() + episodes.size()) == options.episodes) break;
    ETUDE_ASSIGN_OR_RETURN(Episode episode, reader.ReadWhole(index));
    if (episode.cameras.empty() || episode.cameras[0].streams.empty()) continue;
    if (moving) {
      episodes.push_back(std::move(episode));
      continue;
    }
    ETUDE_ASSIGN_OR_RETURN(auto row, Row(episode, options.frames));
    rows.push_back(std::move(row));
  }
  if (moving && !episodes.empty()) return WriteMoving(episodes, picture);
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
