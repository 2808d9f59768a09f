// SPDX-License-Identifier: Apache-2.0
#include "services/cli/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "services/core/check.h"

namespace etude::cli {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kLooks = 0.5;         // of a module's attention: less on the picture is not shown
constexpr double kLeastWeight = 0.01;  // of a patch: less is not shown
constexpr double kFullWeight = 0.2;    // of a patch: more is not tinted more strongly
constexpr double kTint = 0.55;         // of the color, in a patch of full weight
constexpr double kNear = 0.01;         // m before the camera: nearer is not seen
constexpr int kArm = 8;                // px of a cross, from its centre
constexpr int kDot = 3;                // px, radius
constexpr double kTip = 9;             // px of an arrow
constexpr int kFraction = 4;           // bits of a pixel that OpenCV draws lines by
constexpr double kWordFont = 0.42;
constexpr int kTextLine = 16;                 // px
constexpr std::size_t kMostWordLetters = 32;  // of a word that comes over the bus
constexpr std::size_t kMostWords = 12;        // in the corner
constexpr Color kDark{16, 16, 16};
constexpr Color kFrame{150, 150, 150};

struct Hue {
  std::string_view entity;
  Color color;
};
constexpr std::array<Hue, 5> kHues{{{"ee", {255, 160, 40}},
                                    {"target", {50, 220, 255}},
                                    {"obstacle", {255, 80, 80}},
                                    {"others", {255, 80, 80}},
                                    {"reference", {150, 255, 80}}}};
// taken in turn by what else is looked for in the picture
constexpr std::array<Color, 5> kSpareHues{
    {{255, 90, 220}, {180, 140, 255}, {255, 240, 90}, {110, 150, 255}, {90, 255, 200}}};

// What one module says, as far as it can be read.
struct Said {
  std::string module, entity, quantity, word;
  std::vector<double> numbers;                         // all finite
  const policy::ModuleAttention* attention = nullptr;  // where it is shown
  Color color = kWhite;

  bool says_pixel() const { return quantity == "pixel" && numbers.size() == 2; }
  bool says_displacement() const { return quantity == "displacement" && numbers.size() == 3; }
  bool says_place() const { return (quantity == "position" || quantity == "pose") && numbers.size() >= 3; }
  Vector3d place() const { return {numbers[0], numbers[1], numbers[2]}; }
};

std::string TextOf(const OrderedJson& words, const char* key) {
  const auto found = words.find(key);
  return found != words.end() && found->is_string() ? found->get<std::string>() : "";
}

std::vector<double> NumbersOf(const OrderedJson& value) {
  std::vector<double> numbers;
  if (!value.is_array()) return numbers;
  for (const auto& number : value) {
    if (!number.is_number() || !std::isfinite(number.get<double>())) return {};
    numbers.push_back(number.get<double>());
  }
  return numbers;
}

Said Read(const std::string& module, const OrderedJson& words) {
  Said said{.module = module.substr(0, kMostWordLetters)};
  if (!words.is_object()) return said;
  said.entity = TextOf(words, "entity");
  said.quantity = TextOf(words, "quantity");
  const auto value = words.find("value");
  if (value == words.end()) return said;
  said.numbers = NumbersOf(*value);
  if (!value->is_string()) return said;
  said.word = value->get<std::string>().substr(0, kMostWordLetters);
  const auto probability = words.find("probability");
  if (probability != words.end() && probability->is_number())
    said.word += fmt::format(" {:.2f}", probability->get<double>());
  return said;
}

// Hues by what is spoken of, so that a detector, its class and its displacement have one.
class Palette {
 public:
  Color ColorOf(const Said& said, bool seeks) {
    const std::string& of = said.entity.empty() ? said.module : said.entity;
    for (const Hue& hue : kHues)
      if (hue.entity == of) return hue.color;
    if (const auto taken = spare_.find(of); taken != spare_.end()) return taken->second;
    if (!seeks) return kWhite;
    return spare_[of] = kSpareHues[spare_.size() % kSpareHues.size()];
  }

 private:
  std::map<std::string, Color> spare_;
};

std::vector<Said> ReadAll(const policy::Insight& insight) {
  std::vector<Said> all;
  Palette palette;
  for (const auto& [module, words] : insight.modules.items()) {
    Said said = Read(module, words);
    const auto attention = insight.attention.find(module);
    const bool reads_picture = attention != insight.attention.end() && attention->second.reads_picture();
    if (reads_picture && insight.view.width > 0 && insight.view.height > 0 && attention->second.share() >= kLooks)
      said.attention = &attention->second;
    // a hue is kept for who may look at the picture, also while it does not
    said.color = palette.ColorOf(said, reads_picture || said.quantity == "pixel");
    all.push_back(std::move(said));
  }
  return all;
}

cv::Scalar ScalarOf(const Color& color) { return {double(color[0]), double(color[1]), double(color[2])}; }

double Depth(const Camera& camera, const Vector3d& p_W) { return -(camera.X_WC.inverse() * p_W).z(); }

// The part of a-b in [0, most.x] x [0, most.y] (Liang and Barsky, 1984).
std::optional<std::array<Vector2d, 2>> Clip(const Vector2d& a, const Vector2d& b, const Vector2d& most) {
  const Vector2d way = b - a;
  double from = 0, to = 1;
  // keeps the t for which slope * t <= room
  const auto keep = [&](double slope, double room) {
    if (slope > 0) to = std::min(to, room / slope);
    if (slope < 0) from = std::max(from, room / slope);
    if (slope == 0 && room < 0) to = -1;
  };
  for (int axis = 0; axis < 2; ++axis) {
    keep(-way[axis], a[axis]);
    keep(way[axis], most[axis] - a[axis]);
  }
  if (from > to) return std::nullopt;
  return std::array<Vector2d, 2>{a + from * way, a + to * way};
}

// What is drawn on: the enlarged picture of a camera.
class Sheet {
 public:
  Sheet(const Camera& camera, int scale, std::span<std::uint8_t> rgb)
      : camera_(camera), scale_(scale), picture_(camera.height * scale, camera.width * scale, CV_8UC3, rgb.data()) {}

  void Frame(const policy::View& view) {
    const bool whole = view.width >= camera_.width && view.height >= camera_.height;
    if (view.width <= 0 || view.height <= 0 || whole) return;
    cv::rectangle(picture_, cv::Rect(view.u * scale_, view.v * scale_, view.width * scale_, view.height * scale_),
                  ScalarOf(kFrame));
  }

  void Tint(const policy::ModuleAttention& attention, const policy::View& view, const Color& color) {
    const double width = double(scale_) * view.width / attention.columns;
    const double height = double(scale_) * view.height / attention.rows;
    const auto corner = [&](int row, int column) {
      return cv::Point(static_cast<int>(std::lround(view.u * scale_ + column * width)),
                       static_cast<int>(std::lround(view.v * scale_ + row * height)));
    };
    for (int row = 0; row < attention.rows; ++row)
      for (int column = 0; column < attention.columns; ++column)
        Blend(cv::Rect(corner(row, column), corner(row + 1, column + 1)),
              attention.mean.picture[static_cast<std::size_t>(row) * attention.columns + column], color);
  }

  void Arrow(const Vector3d& from_W, const Vector3d& way_W, const std::string& name, const Color& color) {
    const auto seen = VisiblePart(camera_, from_W, from_W + way_W);
    if (!seen) return;
    const cv::Point2d a = Place((*seen)[0]), b = Place((*seen)[1]);
    const double length = cv::norm(b - a);
    // without its end it has no tip
    const bool ends = VisiblePart(camera_, from_W + way_W, from_W + way_W).has_value();
    const double tip = ends && length > 0 ? std::min(0.5, kTip / length) : 0;
    for (const auto& [ink, thickness] : {std::pair(kDark, 4), std::pair(color, 2)})
      cv::arrowedLine(picture_, Fine(a), Fine(b), ScalarOf(ink), thickness, cv::LINE_AA, kFraction, tip);
    Write(fmt::format("{} {:.1f} cm", name, 100 * way_W.norm()), 0.5 * (a + b) + cv::Point2d(8, kTextLine), color);
  }

  void Line(const Vector3d& a_W, const Vector3d& b_W, const Color& color) {
    const auto seen = VisiblePart(camera_, a_W, b_W);
    if (!seen) return;
    for (const auto& [ink, thickness] : {std::pair(kDark, 4), std::pair(color, 2)})
      cv::line(picture_, Fine(Place((*seen)[0])), Fine(Place((*seen)[1])), ScalarOf(ink), thickness, cv::LINE_AA,
               kFraction);
  }

  void Dot(const Vector3d& p_W, const Color& color) {
    const auto seen = VisiblePart(camera_, p_W, p_W);
    if (!seen) return;
    for (const auto& [ink, radius] : {std::pair(kDark, kDot + 1), std::pair(color, kDot)})
      cv::circle(picture_, Near(Place((*seen)[0])), radius, ScalarOf(ink), cv::FILLED);
  }

  void Cross(const Vector2d& pixel, const std::string& name, const Color& color) {
    if (!Clip(pixel, pixel, Vector2d(camera_.width, camera_.height))) return;
    const cv::Point at = Near(Place(pixel));
    for (const auto& [ink, more] : {std::pair(kDark, 1), std::pair(color, 0)}) {
      const int arm = kArm + more, half = 1 + more;
      Fill(cv::Rect(at.x - arm, at.y - half, 2 * arm + 1, 2 * half + 1), ink);
      Fill(cv::Rect(at.x - half, at.y - arm, 2 * half + 1, 2 * arm + 1), ink);
    }
    Write(name, cv::Point2d(at.x + kArm + 3, at.y - 4), color);
  }

  /// Moved so that it stays inside.
  void Write(const std::string& text, const cv::Point2d& at, const Color& color) {
    int below = 0;
    const cv::Size size = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, kWordFont, 1, &below);
    const cv::Point first(std::max(2, std::min(Near(at).x, picture_.cols - size.width - 2)),
                          std::max(size.height + 2, std::min(Near(at).y, picture_.rows - below - 2)));
    for (const auto& [ink, thickness] : {std::pair(kDark, 3), std::pair(color, 1)})
      cv::putText(picture_, text, first, cv::FONT_HERSHEY_SIMPLEX, kWordFont, ScalarOf(ink), thickness, cv::LINE_AA);
  }

 private:
  // OpenCV counts from the first pixel's centre, a camera from its corner.
  cv::Point2d Place(const Vector2d& pixel) const { return {pixel.x() * scale_ - 0.5, pixel.y() * scale_ - 0.5}; }
  static cv::Point Near(const cv::Point2d& place) {
    return {static_cast<int>(std::lround(place.x)), static_cast<int>(std::lround(place.y))};
  }
  static cv::Point Fine(const cv::Point2d& place) { return Near(place * double(1 << kFraction)); }
  cv::Rect Whole() const { return {0, 0, picture_.cols, picture_.rows}; }

  void Fill(const cv::Rect& bar, const Color& color) {
    if (const cv::Rect seen = bar & Whole(); !seen.empty()) picture_(seen).setTo(ScalarOf(color));
  }
  void Blend(const cv::Rect& patch, double weight, const Color& color) {
    const cv::Rect seen = patch & Whole();
    if (!(weight >= kLeastWeight) || seen.empty()) return;
    const double share = kTint * std::min(1.0, weight / kFullWeight);
    cv::Mat part = picture_(seen);
    const cv::Mat paint(part.size(), part.type(), ScalarOf(color));
    cv::addWeighted(part, 1 - share, paint, share, 0, part);
  }

  const Camera& camera_;
  const int scale_;
  cv::Mat picture_;
};

void DrawDisplacements(const std::vector<Said>& all, Sheet& sheet) {
  const auto hand =
      std::ranges::find_if(all, [](const Said& said) { return said.entity == "ee" && said.says_place(); });
  if (hand == all.end()) return;
  for (const Said& said : all)
    if (said.says_displacement()) sheet.Arrow(hand->place(), said.place(), said.module, said.color);
}

void DrawWaypoints(const std::vector<Waypoint>& waypoints, Sheet& sheet) {
  for (std::size_t k = 1; k < waypoints.size(); ++k) sheet.Line(waypoints[k - 1].X_WE.p, waypoints[k].X_WE.p, kWhite);
  for (const auto& waypoint : waypoints) sheet.Dot(waypoint.X_WE.p, kWhite);
}

void WriteWords(const std::vector<Said>& all, Sheet& sheet) {
  std::size_t line = 0;
  for (const Said& said : all) {
    if (said.word.empty() || line == kMostWords) continue;
    sheet.Write(said.module + " " + said.word, cv::Point2d(6, double(kTextLine * ++line)), said.color);
  }
}

}  // namespace

std::vector<ColoredWord> Legend(const policy::Insight& insight) {
  std::vector<ColoredWord> words;
  for (const Said& said : ReadAll(insight))
    if (said.attention != nullptr || said.says_pixel() || said.says_displacement())
      words.push_back({said.module, said.color});
  return words;
}

std::optional<std::array<Vector2d, 2>> VisiblePart(const Camera& camera, const Vector3d& a_W, const Vector3d& b_W) {
  if (!a_W.allFinite() || !b_W.allFinite()) return std::nullopt;
  const double depth_a = Depth(camera, a_W), depth_b = Depth(camera, b_W);
  if (depth_a < kNear && depth_b < kNear) return std::nullopt;
  const auto at_near = [&]() -> Vector3d { return a_W + (kNear - depth_a) / (depth_b - depth_a) * (b_W - a_W); };
  const Vector2d a = camera.Project(depth_a < kNear ? at_near() : a_W);
  const Vector2d b = camera.Project(depth_b < kNear ? at_near() : b_W);
  if (!a.allFinite() || !b.allFinite()) return std::nullopt;
  return Clip(a, b, Vector2d(camera.width, camera.height));
}

void DrawOverlay(const policy::Insight& insight, const Camera& camera, int scale, std::span<std::uint8_t> rgb) {
  const std::size_t size = std::size_t{3} * camera.width * scale * camera.height * scale;
  ETUDE_CHECK(scale > 0 && rgb.size() == size, "scale={} bytes={} of {}", scale, rgb.size(), size);
  const std::vector<Said> all = ReadAll(insight);
  Sheet sheet(camera, scale, rgb);
  sheet.Frame(insight.view);
  for (const Said& said : all)
    if (said.attention != nullptr) sheet.Tint(*said.attention, insight.view, said.color);
  DrawDisplacements(all, sheet);
  DrawWaypoints(insight.waypoints, sheet);
  for (const Said& said : all)
    if (said.says_pixel()) sheet.Cross({said.numbers[0], said.numbers[1]}, said.module, said.color);
  WriteWords(all, sheet);
}

}  // namespace etude::cli
