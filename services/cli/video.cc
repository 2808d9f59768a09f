// SPDX-License-Identifier: Apache-2.0
#include "services/cli/video.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "services/cli/file_names.h"
#include "services/cli/judge_state.h"
#include "services/cli/overlay.h"
#include "services/core/stop.h"
#include "services/episode/action.h"
#include "services/episode/frame_cursor.h"
#include "services/store/dataset.h"
#include "services/video/mp4_writer.h"

namespace etude::cli {
namespace {

constexpr int kScale = 2;
constexpr int kOverlayWidth = 640;    // px at least, so that small text is sharp ...
constexpr int kMostOverlayScale = 4;  // ... unless the picture is tiny
constexpr int kCaptionLine = 19;      // px below the picture
constexpr double kFont = 0.45, kLeastFont = 0.3;
constexpr Color kGrey{170, 170, 170};

using CaptionLines = std::vector<std::vector<ColoredWord>>;

struct Candidate {
  std::uint64_t index = 0;
  bool success = false;
  std::string name;
};

Result<std::vector<Candidate>> Candidates(const store::DatasetReader& reader, const std::string& suffix) {
  std::vector<Candidate> candidates;
  ETUDE_ASSIGN_OR_RETURN(const auto indices, reader.List());
  for (const std::uint64_t index : indices) {
    ETUDE_ASSIGN_OR_RETURN(const auto record, reader.Read(index));
    const Episode& episode = record.episode;
    if (record.frames.empty() || record.frames[0].empty()) continue;
    const Path name = VideoFileName(index, episode.task, episode.outcome);
    candidates.push_back({index, episode.success, name.stem().string() + suffix + name.extension().string()});
  }
  std::stable_partition(candidates.begin(), candidates.end(), [](const auto& item) { return !item.success; });
  return candidates;
}

// Smaller where a line is too long for the picture, down to what can still be read.
void Caption(const CaptionLines& lines, int top, cv::Mat& picture) {
  picture.rowRange(top, picture.rows).setTo(cv::Scalar(24, 24, 24));
  const auto width = [](const std::string& text, double font) {
    return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, font, 1, nullptr).width;
  };
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::string whole;
    for (const auto& word : lines[i]) whole += word.text + "  ";
    const double fits = kFont * (picture.cols - 16) / std::max(1, width(whole, kFont));
    const double font = std::clamp(fits, kLeastFont, kFont);
    int x = 8;
    for (const auto& [text, color] : lines[i]) {
      cv::putText(picture, text, {x, top + 17 + kCaptionLine * static_cast<int>(i)}, cv::FONT_HERSHEY_SIMPLEX, font,
                  cv::Scalar(color[0], color[1], color[2]), 1, cv::LINE_AA);
      x += width(text + "  ", font);
    }
  }
}

// The pictures of one rollout's video.
class Painter {
 public:
  /// @param insights  null: plain pictures. Both are borrowed.
  Painter(const Episode& episode, const DecisionInsights* insights)
      : episode_(episode),
        frames_(episode),
        insights_(insights),
        camera_(episode.cameras[0].camera),
        scale_(insights == nullptr
                   ? kScale
                   : std::clamp((kOverlayWidth + camera_.width - 1) / camera_.width, 1, kMostOverlayScale)),
        enlarged_(episode.cameras[0].layout().frame_bytes() * scale_ * scale_) {
    const int lines = insights == nullptr ? 2 : 4;
    // H.264 halves colours: sides must be even
    const auto even = [](int side) { return side + side % 2; };
    canvas_ = cv::Mat(even(camera_.height * scale_ + kCaptionLine * lines + 6), even(camera_.width * scale_), CV_8UC3,
                      cv::Scalar(24, 24, 24));
  }
  cv::Size size() const { return canvas_.size(); }
  std::size_t pictures() const { return frames_.size(); }

  /// RGB; valid until the next one. @error kCorrupt
  Result<std::span<const std::uint8_t>> Paint(std::size_t k) {
    ETUDE_ASSIGN_OR_RETURN(const auto rgb, frames_.Frame(k));
    cv::Mat large(camera_.height * scale_, camera_.width * scale_, CV_8UC3, enlarged_.data());
    cv::resize(cv::Mat(camera_.height, camera_.width, CV_8UC3, const_cast<std::uint8_t*>(rgb.data())), large,
               large.size(), 0, 0, cv::INTER_CUBIC);
    const int step = static_cast<int>(k) * episode_.image_stride;
    const policy::Insight* insight = InsightAt(step);
    if (insight != nullptr) DrawOverlay(*insight, camera_, scale_, enlarged_);
    large.copyTo(canvas_(cv::Rect(0, 0, large.cols, large.rows)));
    Caption(LinesAt(step, insight), large.rows, canvas_);
    return std::span<const std::uint8_t>(canvas_.data, canvas_.total() * canvas_.elemSize());
  }

 private:
  // of the last decision
  const policy::Insight* InsightAt(int step) const {
    if (insights_ == nullptr) return nullptr;
    const auto next = insights_->upper_bound(step);
    if (next == insights_->begin()) return nullptr;
    const auto& insight = std::prev(next)->second;
    return insight ? &*insight : nullptr;
  }

  CaptionLines LinesAt(int step, const policy::Insight* insight) const {
    CaptionLines lines{
        {{"\"" + episode_.instruction + "\""}},
        {{fmt::format("{:5.2f} s   {} {}   {}", step / kControlRate, episode_.task, episode_.target, episode_.outcome),
          kGrey}}};
    if (insights_ == nullptr) return lines;
    lines.push_back({{JudgeState(episode_.details, step), kGrey}});
    if (insight == nullptr) {
      lines.push_back({{"this decision has no overlay", kGrey}});
    } else {
      lines.push_back(Legend(*insight));
      if (!insight->waypoints.empty()) lines.back().push_back({"waypoints"});
    }
    return lines;
  }

  const Episode& episode_;
  FrameCursor frames_;
  const DecisionInsights* insights_;
  const Camera& camera_;
  const int scale_;
  std::vector<std::uint8_t> enlarged_;  // RGB
  cv::Mat canvas_;
};

Status WriteVideo(const Episode& episode, const DecisionInsights* insights, const Path& path) {
  Painter painter(episode, insights);
  ETUDE_ASSIGN_OR_RETURN(
      auto writer, video::Mp4Writer::Open(path, {.width = painter.size().width,
                                                 .height = painter.size().height,
                                                 .rate = {static_cast<int>(kControlRate), episode.image_stride}}));
  for (std::size_t k = 0; k < painter.pictures(); ++k) {
    ETUDE_ASSIGN_OR_RETURN(const auto picture, painter.Paint(k));
    ETUDE_RETURN_IF_ERROR(writer.Write(picture));
  }
  return writer.Finish();
}

// False: a stop was requested, or nobody answered, and it was not written.
Result<bool> WriteRollout(const Episode& episode, Overlay* overlay, const Path& path) {
  try {
    if (overlay == nullptr) {
      ETUDE_RETURN_IF_ERROR(WriteVideo(episode, nullptr, path));
      return true;
    }
    const auto unanswered = overlay->tally.unanswered, others = overlay->tally.other_checkpoint;
    ETUDE_ASSIGN_OR_RETURN(const DecisionInsights insights, AskInsights(episode, overlay->ask, overlay->tally));
    const bool any = overlay->tally.other_checkpoint > others ||
                     std::ranges::any_of(insights, [](const auto& one) { return one.second.has_value(); });
    // what was not asked to the end, or had no answer at all, would stay without: a later run asks again
    if (StopRequested() || (!any && overlay->tally.unanswered > unanswered)) return false;
    ETUDE_RETURN_IF_ERROR(WriteVideo(episode, &insights, path));
    return true;
  } catch (const cv::Exception& error) {
    return Fail(Code::kInternal, fmt::format("write the video '{}': {}", path.string(), error.what()));
  }
}

}  // namespace

Result<std::vector<Path>> WriteVideos(const Path& rollouts, const Path& folder, int limit, Overlay* overlay) {
  ETUDE_ASSIGN_OR_RETURN(const auto reader, store::DatasetReader::Open(rollouts));
  ETUDE_ASSIGN_OR_RETURN(auto candidates, Candidates(reader, overlay == nullptr ? "" : "-overlay"));
  candidates.resize(std::min(candidates.size(), static_cast<std::size_t>(std::max(limit, 0))));
  if (candidates.empty()) return std::vector<Path>{};
  ETUDE_RETURN_IF_ERROR(MakeFolders(folder));
  std::vector<Path> videos;
  for (const auto& candidate : candidates) {
    const Path path = folder / candidate.name;
    if (!IsMadeOf(path, store::EpisodePath(rollouts, candidate.index))) {
      if (StopRequested()) continue;  // the next run writes it; those that are there are named all the same
      ETUDE_ASSIGN_OR_RETURN(const Episode episode, reader.ReadWhole(candidate.index));
      ETUDE_ASSIGN_OR_RETURN(const bool written, WriteRollout(episode, overlay, path));
      if (!written) continue;  // those that are there are named all the same
    }
    videos.push_back(path);
  }
  return videos;
}

}  // namespace etude::cli
