// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <optional>
#include <span>

#include "services/episode/bounded_json.h"
#include "services/policy/conversion.h"

namespace etude::policy {
namespace {

constexpr std::int64_t kMostNumber = 1 << 22;  // of bytes of attention: see proto/policy.idl
constexpr std::uint32_t kMostSide = 1 << 14;   // px

const OrderedJson& Member(const OrderedJson& json, const char* key) {
  static const OrderedJson kNone;
  const auto found = json.find(key);
  return found == json.end() ? kNone : *found;
}

// A whole number in 0..kMostNumber.
std::optional<std::size_t> NumberOf(const OrderedJson& json) {
  if (!json.is_number_integer()) return std::nullopt;
  const auto number = json.get<std::int64_t>();
  if (number < 0 || number > kMostNumber) return std::nullopt;
  return static_cast<std::size_t>(number);
}

// Where the bytes of one module's attention lie, see trainer/serve/insight.h.
struct Place {
  std::size_t offset = 0, heads = 0, rows = 0, columns = 0, keys = 0;
  std::vector<double> scale;  // of each head

  std::size_t tokens() const { return rows * columns; }
  // numbers up to kMostNumber: no product overflows where the ones before it have been looked at
  bool Fits(std::size_t size) const {
    return heads > 0 && tokens() > 0 && tokens() <= size && keys <= size && heads <= size && offset <= size &&
           heads * (tokens() + keys) <= size - offset;
  }
};

std::optional<Place> PlaceOf(const OrderedJson& json) {
  const OrderedJson &image = Member(json, "image"), &keys = Member(json, "keys"), &scale = Member(json, "scale");
  if (!image.is_array() || image.size() != 2 || !keys.is_array() || !scale.is_array()) return std::nullopt;
  const auto offset = NumberOf(Member(json, "offset")), heads = NumberOf(Member(json, "heads"));
  const auto rows = NumberOf(image.front()), columns = NumberOf(image.back());
  if (!offset || !heads || !rows || !columns || scale.size() != *heads) return std::nullopt;
  Place place{*offset, *heads, *rows, *columns, keys.size(), {}};
  for (const auto& largest : scale) {
    if (!largest.is_number()) return std::nullopt;
    place.scale.push_back(largest.get<double>());
  }
  return place;
}

PictureAttention AttentionAt(const Place& place, std::span<const std::uint8_t> bytes) {
  PictureAttention attention{static_cast<int>(place.rows), static_cast<int>(place.columns),
                             std::vector<double>(place.tokens())};
  for (std::size_t h = 0; h < place.heads; ++h) {
    const std::size_t first = place.offset + h * (place.tokens() + place.keys);
    const double weight = place.scale[h] / (255.0 * static_cast<double>(place.heads));
    for (std::size_t k = 0; k < place.tokens(); ++k) attention.weights[k] += weight * bytes[first + k];
  }
  return attention;
}

Status ReadAttention(const bus::Insight& message, Insight& insight) {
  const auto layout = ParseBoundedJson(message.attention_json);
  if (!layout || !layout->is_object()) return Fail(Code::kCorrupt, "read an insight: its attention has no layout");
  std::size_t left = message.attention.size();  // each module has bytes of its own
  for (const auto& [module, json] : layout->items()) {
    if (!json.is_object() || !json.contains("image")) continue;
    const auto place = PlaceOf(json);
    if (!place || !place->Fits(message.attention.size()) || place->tokens() > left)
      return Fail(Code::kCorrupt, fmt::format("read an insight: the attention of {} does not fit its {} bytes", module,
                                              message.attention.size()));
    left -= place->tokens();
    insight.attention[module] = AttentionAt(*place, message.attention);
  }
  return {};
}

}  // namespace

double PictureAttention::share() const { return std::accumulate(weights.begin(), weights.end(), 0.0); }

Result<Insight> ReadInsight(const bus::Insight& message) {
  if (!message.error.empty()) return Fail(Code::kInvalidArgument, message.error);
  Insight insight;
  insight.checkpoint_step = message.checkpoint_step;
  auto modules = ParseBoundedJson(message.modules_json);
  if (!modules || !modules->is_object()) return Fail(Code::kCorrupt, "read an insight: it says nothing of modules");
  insight.modules = std::move(*modules);
  if (!message.what_if_json.empty()) {
    auto what_if = ParseBoundedJson(message.what_if_json);
    if (!what_if || !what_if->is_object())
      return Fail(Code::kCorrupt, "read an insight: what it says to the what-if is no JSON object");
    insight.what_if = std::move(*what_if);
  }
  ETUDE_RETURN_IF_ERROR(ReadAttention(message, insight));
  const auto& view = message.view;
  if (!view.empty() && (view.size() != 4 || std::ranges::any_of(view, [](auto side) { return side > kMostSide; })))
    return Fail(Code::kCorrupt, "read an insight: its view is no part of a picture");
  if (!view.empty())
    insight.view = {static_cast<int>(view[0]), static_cast<int>(view[1]), static_cast<int>(view[2]),
                    static_cast<int>(view[3])};
  if (!message.waypoints.empty() && !AreWaypoints(message.waypoints))
    return Fail(Code::kCorrupt, fmt::format("read an insight: {} numbers are no {} finite waypoints",
                                            message.waypoints.size(), kWaypoints));
  if (!message.waypoints.empty()) insight.waypoints = WaypointsOf(message.waypoints);
  return insight;
}

}  // namespace etude::policy
