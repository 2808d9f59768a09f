// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/depth_network.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

#include "worker/synthesis/decoded_picture.h"

namespace etude::synthesis {
namespace {

/// 255 where a pixel is not joined to the border by pixels of the border's colour.
cv::Mat ObjectMask(const cv::Mat& colors, double tolerance) {
  const int limit = static_cast<int>(255 * tolerance);
  cv::Mat marks(colors.rows + 2, colors.cols + 2, CV_8UC1, cv::Scalar(0)), flooded = colors.clone();
  const int flags = 4 | (255 << 8) | cv::FLOODFILL_MASK_ONLY | cv::FLOODFILL_FIXED_RANGE;
  for (const cv::Point& corner : {cv::Point(0, 0), cv::Point(colors.cols - 1, 0), cv::Point(0, colors.rows - 1),
                                  cv::Point(colors.cols - 1, colors.rows - 1)})
    if (marks.at<std::uint8_t>(corner.y + 1, corner.x + 1) == 0)
      cv::floodFill(flooded, marks, corner, {}, nullptr, cv::Scalar::all(limit), cv::Scalar::all(limit), flags);
  return marks(cv::Rect(1, 1, colors.cols, colors.rows)) == 0;
}

/// Stretches what is on the object from its fifth percentile (0.05) to its nearest point (1).
void FillDepth(const cv::Mat& nearness, const cv::Mat& mask, Picture& picture) {
  std::vector<float> values;
  for (int i = 0; i < static_cast<int>(nearness.total()); ++i)
    if (mask.at<std::uint8_t>(i)) values.push_back(nearness.at<float>(i));
  std::sort(values.begin(), values.end());
  const float low = values[values.size() / 20], high = values.back();
  for (int i = 0; i < static_cast<int>(nearness.total()); ++i) {
    const bool is_object = mask.at<std::uint8_t>(i) != 0;
    const float share = high > low ? std::clamp((nearness.at<float>(i) - low) / (high - low), 0.0f, 1.0f) : 1.0f;
    picture.mask.push_back(is_object);
    picture.depth.push_back(is_object ? 0.05f + 0.95f * share : 0.0f);
  }
}

}  // namespace

struct DepthNetwork::Impl {
  cv::dnn::Net net;
  DepthNetworkOptions options;

  /// Nearness of each pixel. @error kInvalidArgument: not a picture of numbers.
  Result<cv::Mat> Nearness(const cv::Mat& colors) {
    // ImageNet's mean and spread of red, green, blue
    cv::Mat blob = cv::dnn::blobFromImage(colors, 1 / 255.0, {options.width, options.height}, {}, true, false);
    const double mean[] = {0.485, 0.456, 0.406}, spread[] = {0.229, 0.224, 0.225};
    for (int c = 0; c < 3; ++c) {
      cv::Mat plane(options.height, options.width, CV_32F, blob.ptr<float>(0, c));
      plane = (plane - mean[c]) / spread[c];
    }
    net.setInput(blob);
    const cv::Mat output = net.forward();
    const int rows = output.dims >= 3 ? output.size[output.dims - 2] : 0;
    const int columns = output.dims >= 3 ? output.size[output.dims - 1] : 0;
    if (output.depth() != CV_32F || rows < 8 || columns < 8 ||
        output.total() != static_cast<std::size_t>(rows) * columns)
      return Fail(Code::kInvalidArgument,
                  fmt::format("the network's output has {} numbers in {} dimensions, not one picture of depth",
                              output.total(), output.dims));
    if (!cv::checkRange(cv::Mat(rows, columns, CV_32F, output.data)))
      return Fail(Code::kInvalidArgument, "the network's output has depths that are no finite numbers");
    cv::Mat nearness;
    cv::resize(cv::Mat(rows, columns, CV_32F, output.data), nearness, colors.size(), 0, 0, cv::INTER_CUBIC);
    return nearness;
  }
};

DepthNetwork::DepthNetwork(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthNetwork::DepthNetwork(DepthNetwork&&) noexcept = default;
DepthNetwork::~DepthNetwork() = default;

Result<DepthNetwork> DepthNetwork::Open(const Path& onnx, const DepthNetworkOptions& options) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(onnx, error))
    return Fail(Code::kNotFound,
                fmt::format("depth network '{}': no such file; any ONNX network from RGB to inverse depth will do, "
                            "for example MiDaS v2.1 small (model-small.onnx of github.com/isl-org/MiDaS)",
                            onnx.string()));
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  try {
    impl->net = cv::dnn::readNetFromONNX(onnx.string());
  } catch (const cv::Exception& exception) {
    return Fail(Code::kCorrupt, fmt::format("depth network '{}': {}", onnx.string(), exception.what()));
  }
  return DepthNetwork(std::move(impl));
}

Result<Picture> DepthNetwork::Read(const Path& rgb) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(rgb, 1u << 28));
  cv::Mat colors = Decoded(bytes, cv::IMREAD_COLOR);
  if (colors.empty()) return Fail(Code::kCorrupt, fmt::format("read '{}': not a picture", rgb.string()));
  const cv::Mat mask = ObjectMask(colors, impl_->options.background);
  if (cv::countNonZero(mask) < 64)
    return Fail(Code::kInvalidArgument, fmt::format("read '{}': no object on a plain background", rgb.string()));
  try {
    ETUDE_ASSIGN_OR_RETURN(const cv::Mat nearness, impl_->Nearness(colors));
    Picture picture{.width = colors.cols, .height = colors.rows, .relief = impl_->options.relief};
    cv::cvtColor(colors, colors, cv::COLOR_BGR2RGB);
    picture.rgb.assign(colors.data, colors.data + 3 * colors.total());
    FillDepth(nearness, mask, picture);
    return picture;
  } catch (const cv::Exception& exception) {
    return Fail(Code::kInvalidArgument, fmt::format("depth of '{}': {}", rgb.string(), exception.what()));
  }
}

}  // namespace etude::synthesis
