// SPDX-License-Identifier: Apache-2.0
#include "worker/view/scene_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "worker/task/attempt.h"

namespace etude {
namespace {

constexpr int kJpegQuality = 90;

Status Write(const std::vector<cv::Mat>& pictures, const Path& path) {
  cv::Mat strip;
  cv::hconcat(pictures, strip);
  const char* kind = path.extension() == ".jpg" ? ".jpg" : ".png";
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(kind, strip, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality}))
    return Fail(Code::kInternal, fmt::format("write '{}': encoding failed", path.string()));
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, bytes));
  fmt::print("{}\n", path.string());
  return {};
}

// "a.png" -> "a-depth.png"
Path Beside(const Path& picture, const std::string& what, const std::string& kind) {
  return picture.parent_path() / (picture.stem().string() + "-" + what + kind);
}

cv::Mat Colour(const task::StartScene& scene, const Camera& camera) {
  cv::Mat picture(camera.height, camera.width, CV_8UC3);
  scene.renderer->Render(*scene.world, {picture.data, picture.total() * 3});
  cv::cvtColor(picture, picture, cv::COLOR_RGB2BGR);
  return picture;
}

cv::Mat Segmentation(const task::StartScene& scene, const Camera& camera) {
  std::vector<std::int32_t> bodies(static_cast<std::size_t>(camera.width) * camera.height);
  scene.renderer->RenderSegmentation(*scene.world, bodies);
  // hues a golden angle apart: neighbours in number are far apart in colour
  cv::Mat hue(camera.height, camera.width, CV_8UC3);
  std::transform(bodies.begin(), bodies.end(), hue.begin<cv::Vec3b>(), [](std::int32_t body) {
    if (body < 0) return cv::Vec3b(0, 0, 0);
    return cv::Vec3b(static_cast<std::uint8_t>(body * 110 % 180), body == 0 ? 0 : 200, body == 0 ? 90 : 235);
  });
  cv::cvtColor(hue, hue, cv::COLOR_HSV2BGR);
  return hue;
}

cv::Mat Depth(const task::StartScene& scene, const Camera& camera) {
  std::vector<float> depth(static_cast<std::size_t>(camera.width) * camera.height);
  scene.renderer->RenderDepth(*scene.world, depth);
  cv::Mat millimetres(camera.height, camera.width, CV_16UC1);
  std::transform(depth.begin(), depth.end(), millimetres.begin<std::uint16_t>(),
                 [](float z) { return static_cast<std::uint16_t>(std::clamp(1000.0f * z + 0.5f, 0.0f, 65535.0f)); });
  return millimetres;
}

}  // namespace

Status WriteScenePictures(const CampaignSpec& spec, const Path& picture, const ScenePictureOptions& options,
                          const sim::RendererConfig& renderer) {
  if (options.indices.empty()) return Fail(Code::kInvalidArgument, "render scenes: no episode is named");
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  std::vector<cv::Mat> colours, segmentations, depths;
  for (const std::uint64_t index : options.indices) {
    ETUDE_ASSIGN_OR_RETURN(const auto scene, runner.Show(index, options.attempt));
    const Camera& camera = scene.renderer->camera();
    const EpisodePlan& plan = scene.plan;
    fmt::print("episode {}: \"{}\" ({}: {} {}{})\n", index, scene.instruction, plan.scene.robot, plan.task.text(),
               plan.target, plan.reference.empty() ? "" : ", " + plan.reference);
    colours.push_back(Colour(scene, camera));
    if (options.segmentation) segmentations.push_back(Segmentation(scene, camera));
    if (options.depth) depths.push_back(Depth(scene, camera));
  }
  ETUDE_RETURN_IF_ERROR(Write(colours, picture));
  const std::string kind = picture.extension() == ".jpg" ? ".jpg" : ".png";
  if (options.segmentation) ETUDE_RETURN_IF_ERROR(Write(segmentations, Beside(picture, "segmentation", kind)));
  if (options.depth) ETUDE_RETURN_IF_ERROR(Write(depths, Beside(picture, "depth", ".png")));
  return {};
}

}  // namespace etude
