// SPDX-License-Identifier: Apache-2.0
#include "worker/synthesis/heightfield.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "worker/synthesis/mass.h"

namespace etude::synthesis {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// the least height of a vertex inside of the outline, in widths: front and back never touch
constexpr double kThinnest = 0.004;
// a hole is at least such a share of the object's area
constexpr double kLeastHole = 0.015;

Status Validate(const Picture& picture, const HeightfieldOptions& options) {
  const std::size_t n = picture.pixels();
  if (picture.width < 8 || picture.height < 8 || picture.rgb.size() != 3 * n || picture.depth.size() != n ||
      picture.mask.size() != n)
    return Fail(
        Code::kInvalidArgument,
        fmt::format("make a heightfield: a picture of {} x {} px with {} colours, {} depths, {} of mask", picture.width,
                    picture.height, picture.rgb.size(), picture.depth.size(), picture.mask.size()));
  if (options.max_faces < 100 || options.cut < 0 || options.cut > 0.5 || options.smoothing < 0 ||
      options.smoothing > 1 || options.rounds < 0 || picture.relief <= 0)
    return Fail(Code::kInvalidArgument,
                fmt::format("make a heightfield: max_faces {}, cut {}, smoothing {}, rounds {}, relief {} out of range",
                            options.max_faces, options.cut, options.smoothing, options.rounds, picture.relief));
  return {};
}

/// The depth of a picture between its pixels: bilinear, 0 off the object.
class DepthField {
 public:
  explicit DepthField(const Picture& picture) : picture_(picture) {}

  /// @param p  px; the middle of the first pixel is (0.5, 0.5)
  double At(const Vector2d& p) const {
    const double x = p.x() - 0.5, y = p.y() - 0.5;
    const int ix = static_cast<int>(std::floor(x)), iy = static_cast<int>(std::floor(y));
    const double low = std::lerp(Pixel(ix, iy), Pixel(ix + 1, iy), x - ix);
    const double high = std::lerp(Pixel(ix, iy + 1), Pixel(ix + 1, iy + 1), x - ix);
    return std::lerp(low, high, y - iy);
  }

 private:
  double Pixel(int x, int y) const {
    if (x < 0 || y < 0 || x >= picture_.width || y >= picture_.height) return 0;
    const std::size_t i = static_cast<std::size_t>(y) * picture_.width + x;
    return picture_.mask[i] ? picture_.depth[i] : 0;
  }

  const Picture& picture_;
};

/// A square grid over the picture and beyond its border, each square split by the diagonal from its upper left. The
/// outline is where the depth crosses the cut; each triangle is clipped there, so that the front half is a surface
/// whose border is the outline alone, whatever the picture.
class Grid {
 public:
  Grid(const Picture& picture, double cut, double spacing)
      : picture_(picture),
        field_(picture),
        cut_(cut),
        spacing_(spacing),
        columns_(static_cast<int>(std::ceil(picture.width / spacing)) + 3),
        rows_(static_cast<int>(std::ceil(picture.height / spacing)) + 3) {
    depth_.resize(static_cast<std::size_t>(columns_) * rows_);
    for (int i = 0; i < size(); ++i) depth_[i] = field_.At(Place(i));
    KeepLargestPart();
  }

  HeightfieldBody Build() {
    HeightfieldBody body;
    index_.assign(size(), {-1, -1});
    for (int row = 0; row + 1 < rows_; ++row)
      for (int column = 0; column + 1 < columns_; ++column) {
        const int a = row * columns_ + column, b = a + 1, d = a + columns_, c = d + 1;
        AddTriangle({a, d, c}, body.mesh);
        AddTriangle({a, c, b}, body.mesh);
      }
    body.hole = FindHole();
    return body;
  }

 private:
  int size() const { return columns_ * rows_; }
  Vector2d Place(int i) const { return spacing_ * Vector2d(i % columns_ - 1, i / columns_ - 1); }
  bool Inside(int i) const { return depth_[i] > cut_; }
  Vector3d ToBody(const Vector2d& p, double z) const {
    return {(p.x() - picture_.width / 2.0) / picture_.width, (picture_.height / 2.0 - p.y()) / picture_.width, z};
  }

  /// Grid points connected to `start` by edges of the triangles, among those with Inside() == `inside`.
  std::vector<int> Connected(int start, bool inside, std::vector<bool>& seen) const {
    std::vector<int> found{start};
    seen[start] = true;
    for (std::size_t k = 0; k < found.size(); ++k) {
      const int column = found[k] % columns_, row = found[k] / columns_;
      for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, -1}}) {
        const int x = column + dx, y = row + dy, i = y * columns_ + x;
        if (x < 0 || y < 0 || x >= columns_ || y >= rows_ || seen[i] || Inside(i) != inside) continue;
        seen[i] = true;
        found.push_back(i);
      }
    }
    return found;
  }

  void KeepLargestPart() {
    std::vector<bool> seen(size());
    std::vector<std::vector<int>> parts;
    for (int i = 0; i < size(); ++i)
      if (Inside(i) && !seen[i]) parts.push_back(Connected(i, true, seen));
    const auto by_size = [](const auto& a, const auto& b) { return a.size() < b.size(); };
    const auto largest = std::max_element(parts.begin(), parts.end(), by_size);
    for (auto part = parts.begin(); part != parts.end(); ++part)
      if (part != largest)
        for (const int i : *part) depth_[i] = 0;
  }

  /// The largest part of the outside that the border does not reach; gaps beside a leaf are no hole.
  std::optional<Hole> FindHole() const {
    std::vector<bool> seen(size());
    Connected(0, false, seen);
    std::vector<int> largest;
    for (int i = 0; i < size(); ++i) {
      if (seen[i] || Inside(i)) continue;
      auto part = Connected(i, false, seen);
      if (part.size() > largest.size()) largest = std::move(part);
    }
    const auto inside = std::count_if(depth_.begin(), depth_.end(), [&](double depth) { return depth > cut_; });
    if (static_cast<double>(largest.size()) <= kLeastHole * static_cast<double>(inside)) return std::nullopt;
    Vector2d sum = Vector2d::Zero();
    for (const int i : largest) sum += Place(i);
    return Hole{ToBody(sum / static_cast<double>(largest.size()), 0), Vector3d::UnitZ()};
  }

  int AddVertex(const Vector2d& p, double z, assets::Mesh& mesh) const {
    mesh.positions.push_back(ToBody(p, z));
    mesh.uv.emplace_back(p.x() / picture_.width, p.y() / picture_.height);
    return static_cast<int>(mesh.positions.size()) - 1;
  }

  /// The vertices in front and behind of a grid point.
  std::pair<int, int> AtPoint(int i, assets::Mesh& mesh) {
    if (index_[i].first < 0) {
      const double z = std::max(kThinnest, depth_[i] * picture_.relief);
      index_[i].first = AddVertex(Place(i), z, mesh);
      index_[i].second = AddVertex(Place(i), -z, mesh);
    }
    return index_[i];
  }

  /// The vertex of the outline on an edge, shared by both halves. Kept off the edge's ends: no slivers.
  std::pair<int, int> OnEdge(int inside, int outside, assets::Mesh& mesh) {
    const auto [place, is_new] = outline_.try_emplace({inside, outside}, -1);
    if (is_new) {
      const Vector2d from = Place(inside), to = Place(outside);
      double low = 0, high = 1;
      for (int k = 0; k < 12; ++k) {
        const double middle = (low + high) / 2;
        (field_.At(from + middle * (to - from)) > cut_ ? low : high) = middle;
      }
      place->second = AddVertex(from + std::clamp(low, 0.15, 0.85) * (to - from), 0, mesh);
    }
    return {place->second, place->second};
  }

  /// What of a triangle is inside, in front and, turned round, behind.
  void AddTriangle(const std::array<int, 3>& corners, assets::Mesh& mesh) {
    std::vector<std::pair<int, int>> polygon;
    for (int k = 0; k < 3; ++k) {
      const int from = corners[k], to = corners[(k + 1) % 3];
      if (Inside(from)) polygon.push_back(AtPoint(from, mesh));
      if (Inside(from) && !Inside(to)) polygon.push_back(OnEdge(from, to, mesh));
      if (!Inside(from) && Inside(to)) polygon.push_back(OnEdge(to, from, mesh));
    }
    if (polygon.empty()) return;

    // a fan from a vertex that is not on the outline: no face has all its corners there
    const auto on_outline = [](const auto& vertex) { return vertex.first == vertex.second; };
    std::rotate(polygon.begin(), std::find_if_not(polygon.begin(), polygon.end(), on_outline), polygon.end());
    for (std::size_t k = 1; k + 1 < polygon.size(); ++k) {
      mesh.faces.push_back({polygon[0].first, polygon[k].first, polygon[k + 1].first});
      mesh.faces.push_back({polygon[0].second, polygon[k + 1].second, polygon[k].second});
    }
  }

  const Picture& picture_;
  DepthField field_;
  double cut_, spacing_;
  int columns_, rows_;
  std::vector<double> depth_;
  std::vector<std::pair<int, int>> index_;  // of each grid point: vertex in front, behind
  std::map<std::pair<int, int>, int> outline_;
};

}  // namespace

Result<HeightfieldBody> RaiseHeightfield(const Picture& picture, const HeightfieldOptions& options) {
  ETUDE_RETURN_IF_ERROR(Validate(picture, options));
  std::size_t area = 0;
  for (std::size_t i = 0; i < picture.pixels(); ++i) area += picture.mask[i] && picture.depth[i] > options.cut;
  if (area < 16) return Fail(Code::kInvalidArgument, fmt::format("make a heightfield: {} px of object", area));

  // two faces in front and two behind for each square
  double spacing = std::max(1.0, std::sqrt(4.0 * area / (0.95 * options.max_faces)));
  HeightfieldBody body = Grid(picture, options.cut, spacing).Build();
  while (static_cast<int>(body.mesh.faces.size()) > options.max_faces) {
    spacing *= 1.04;
    body = Grid(picture, options.cut, spacing).Build();
  }
  if (body.mesh.faces.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("make a heightfield: {} px of object, none as wide as {:.1f} px", area, spacing));
  Smooth(body.mesh, options.smoothing, options.rounds);
  return body;
}

void Smooth(assets::Mesh& mesh, double factor, int rounds) {
  const double volume = Integrate(mesh).mass;
  std::vector<Vector3d> sum(mesh.positions.size());
  std::vector<double> count(mesh.positions.size());
  for (int round = 0; round < rounds; ++round) {
    std::fill(sum.begin(), sum.end(), Vector3d::Zero());
    std::fill(count.begin(), count.end(), 0);
    // every edge of a closed mesh comes up once in each direction
    for (const auto& face : mesh.faces)
      for (int k = 0; k < 3; ++k) {
        sum[face[k]] += mesh.positions[face[(k + 1) % 3]];
        count[face[k]] += 1;
      }
    for (std::size_t i = 0; i < sum.size(); ++i)
      if (count[i] > 0) mesh.positions[i] += factor * (sum[i] / count[i] - mesh.positions[i]);
  }
  const MassProperties now = Integrate(mesh);
  if (now.mass > 0 && volume > 0) {
    const double scale = std::cbrt(volume / now.mass);
    for (Vector3d& p : mesh.positions) p = now.centre + scale * (p - now.centre);
  }
  ComputeNormals(mesh);
}

}  // namespace etude::synthesis
