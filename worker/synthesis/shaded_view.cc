// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/shaded_view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace etude::synthesis {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kSamples = 3;  // per pixel and axis
constexpr double kAmbient = 0.45, kDiffuse = 0.62;

/// Colour of the texture at (u, v), 0..255; the nearest texel.
Vector3d Sample(const Texture& texture, const Vector2d& uv) {
  if (texture.rgb.empty()) return Vector3d::Constant(180);
  const double u = uv.x() - std::floor(uv.x()), v = uv.y() - std::floor(uv.y());  // it repeats, as in scenes
  const int x = std::clamp(static_cast<int>(u * texture.width), 0, texture.width - 1);
  const int y = std::clamp(static_cast<int>(v * texture.height), 0, texture.height - 1);
  const std::uint8_t* texel = texture.rgb.data() + 3 * (static_cast<std::size_t>(y) * texture.width + x);
  return {static_cast<double>(texel[0]), static_cast<double>(texel[1]), static_cast<double>(texel[2])};
}

/// Samples of the picture with the depth of what they show.
class Canvas {
 public:
  explicit Canvas(int size)
      : size_(size),
        colors_(static_cast<std::size_t>(size) * size, Vector3d::Constant(255)),
        depth_(colors_.size(), -std::numeric_limits<double>::infinity()) {}

  /// A triangle in samples (x right, y down, z towards the viewer); `color` of barycentric coordinates.
  template <class ColorAt>
  void Fill(const Vector3d (&p)[3], const ColorAt& color) {
    const auto cross = [](const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); };
    const Vector2d a = p[0].head<2>(), b = p[1].head<2>(), c = p[2].head<2>();
    const double area = cross(b - a, c - a);
    if (std::abs(area) < 1e-12) return;
    const Vector2d low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
    for (int y = std::max(0, static_cast<int>(low.y())); y <= std::min(size_ - 1.0, high.y()); ++y)
      for (int x = std::max(0, static_cast<int>(low.x())); x <= std::min(size_ - 1.0, high.x()); ++x) {
        const Vector2d q(x + 0.5, y + 0.5);
        const Vector3d share(cross(c - b, q - b) / area, cross(a - c, q - c) / area, cross(b - a, q - a) / area);
        if (share.minCoeff() < 0) continue;
        const double z = share.x() * p[0].z() + share.y() * p[1].z() + share.z() * p[2].z();
        const std::size_t i = static_cast<std::size_t>(y) * size_ + x;
        if (z <= depth_[i]) continue;
        depth_[i] = z;
        colors_[i] = color(share);
      }
  }

  Texture Shrunk(int times) const {
    const int size = size_ / times;
    Texture picture{size, size, {}};
    for (int y = 0; y < size; ++y)
      for (int x = 0; x < size; ++x) {
        Vector3d sum = Vector3d::Zero();
        for (int k = 0; k < times * times; ++k)
          sum += colors_[static_cast<std::size_t>(times * y + k / times) * size_ + times * x + k % times];
        for (int c = 0; c < 3; ++c)
          picture.rgb.push_back(static_cast<std::uint8_t>(std::clamp(sum[c] / (times * times), 0.0, 255.0)));
      }
    return picture;
  }

 private:
  int size_;
  std::vector<Vector3d> colors_;
  std::vector<double> depth_;
};

}  // namespace

Texture ShadedView(const assets::Mesh& mesh, const Texture& texture, const ViewOptions& options) {
  // rows: right, up and towards the camera, of a camera in +y that looks down
  const double c = std::cos(options.elevation), s = std::sin(options.elevation);
  Matrix3d to_camera;
  to_camera << -1, 0, 0, 0, -s, c, 0, c, s;
  to_camera = to_camera * Eigen::AngleAxisd(options.yaw, Vector3d::UnitZ()).toRotationMatrix();
  const Vector3d sun = Vector3d(0.35, 0.75, 0.6).normalized();

  Canvas canvas(options.size * kSamples);
  const double scale = options.size * kSamples / options.extent, middle = options.size * kSamples / 2.0;
  for (const auto& face : mesh.faces) {
    Vector3d corners[3];
    for (int k = 0; k < 3; ++k) {
      const Vector3d p = scale * (to_camera * mesh.positions[face[k]]);
      corners[k] = {middle + p.x(), middle - p.y(), p.z()};
    }
    canvas.Fill(corners, [&](const Vector3d& share) {
      Vector3d normal = Vector3d::Zero();
      Vector2d uv = Vector2d::Zero();
      for (int k = 0; k < 3; ++k) {
        normal += share[k] * mesh.normals[face[k]];
        uv += share[k] * mesh.uv[face[k]];
      }
      const double light = std::max(0.0, (to_camera * normal).normalized().dot(sun));
      return Vector3d((kAmbient + kDiffuse * light) * Sample(texture, uv));
    });
  }
  return canvas.Shrunk(kSamples);
}

}  // namespace etude::synthesis
