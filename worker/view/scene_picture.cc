// SPDX-License-Identifier: Apache-2.0
#include "worker/view/scene_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "worker/task/attempt.h"

namespace etude {
namespace {

Status Write(const cv::Mat& picture, const Path& png) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) return Fail(Code::kInternal, "PNG encoding failed");
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(png, bytes));
  fmt::print("{}\n", png.string());
  return {};
}

// "a.png" -> "a-depth.png"
Path Beside(const Path& png, const std::string& what) {
  return png.parent_path() / (png.stem().string() + "-" + what + ".png");
}

Status WriteColour(const task::StartScene& scene, const Camera& camera, const Path& png) {
  cv::Mat picture(camera.height, camera.width, CV_8UC3);
  scene.renderer->Render(*scene.world, {picture.data, picture.total() * 3});
  cv::cvtColor(picture, picture, cv::COLOR_RGB2BGR);
  return Write(picture, png);
}

Status WriteSegmentation(const task::StartScene& scene, const Camera& camera, const Path& png) {
  std::vector<std::int32_t> bodies(static_cast<std::size_t>(camera.width) * camera.height);
  scene.renderer->RenderSegmentation(*scene.world, bodies);
  // hues a golden angle apart: neighbours in number are far apart in colour
  cv::Mat hue(camera.height, camera.width, CV_8UC3);
  std::transform(bodies.begin(), bodies.end(), hue.begin<cv::Vec3b>(), [](std::int32_t body) {
    if (body < 0) return cv::Vec3b(0, 0, 0);
    return cv::Vec3b(static_cast<std::uint8_t>(body * 110 % 180), body == 0 ? 0 : 200, body == 0 ? 90 : 235);
  });
  cv::cvtColor(hue, hue, cv::COLOR_HSV2BGR);
  return Write(hue, png);
}

Status WriteDepth(const task::StartScene& scene, const Camera& camera, const Path& png) {
  std::vector<float> depth(static_cast<std::size_t>(camera.width) * camera.height);
  scene.renderer->RenderDepth(*scene.world, depth);
  cv::Mat millimetres(camera.height, camera.width, CV_16UC1);
  std::transform(depth.begin(), depth.end(), millimetres.begin<std::uint16_t>(),
                 [](float z) { return static_cast<std::uint16_t>(std::clamp(1000.0f * z + 0.5f, 0.0f, 65535.0f)); });
  return Write(millimetres, png);
}

}  // namespace

Status WriteScenePictures(const CampaignSpec& spec, const Path& png, const ScenePictureOptions& options,
                          const sim::RendererConfig& renderer) {
  ETUDE_ASSIGN_OR_RETURN(auto runner, task::AttemptRunner::Open(spec, renderer));
  ETUDE_ASSIGN_OR_RETURN(const auto scene, runner.Show(options.index, options.attempt));
  const Camera& camera = scene.world->scene().camera();
  fmt::print("episode {}: \"{}\" ({}: {} {}{})\n", options.index, scene.instruction, scene.robot, scene.task,
             scene.target, scene.reference.empty() ? "" : ", " + scene.reference);
  ETUDE_RETURN_IF_ERROR(WriteColour(scene, camera, png));
  if (options.segmentation) ETUDE_RETURN_IF_ERROR(WriteSegmentation(scene, camera, Beside(png, "segmentation")));
  if (options.depth) ETUDE_RETURN_IF_ERROR(WriteDepth(scene, camera, Beside(png, "depth")));
  return {};
}

}  // namespace etude
