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
constexpr std::size_t kMostHeads = 64;
constexpr std::size_t kMostWorth = 64 << 10;  // bytes

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
  std::size_t offset = 0, heads = 0, rows = 0, columns = 0;  // rows and columns 0: it reads no picture
  std::vector<std::string> keys;
  std::vector<double> scale;  // of each head

  std::size_t tokens() const { return rows * columns; }
  std::size_t weights() const { return tokens() + keys.size(); }  // of a head
  // numbers up to kMostNumber: no product overflows where the ones before it have been looked at
  bool Fits(std::size_t size) const {
    return heads > 0 && (rows > 0) == (columns > 0) && weights() > 0 && tokens() <= size && keys.size() <= size &&
           heads <= kMostHeads && offset <= size && heads * weights() <= size - offset;
  }
};

// Nothing of a module that reads no picture; two positive numbers of one that does.
bool ReadGrid(const OrderedJson& json, Place& place) {
  const auto image = json.find("image");
  if (image == json.end()) return true;
  if (!image->is_array() || image->size() != 2) return false;
  place.rows = NumberOf(image->front()).value_or(0);
  place.columns = NumberOf(image->back()).value_or(0);
  return place.rows > 0 && place.columns > 0;
}

std::optional<Place> PlaceOf(const OrderedJson& json) {
  if (!json.is_object()) return std::nullopt;
  const OrderedJson &keys = Member(json, "keys"), &scale = Member(json, "scale");
  if (!keys.is_array() || !scale.is_array()) return std::nullopt;
  const auto offset = NumberOf(Member(json, "offset")), heads = NumberOf(Member(json, "heads"));
  if (!offset || !heads || scale.size() != *heads) return std::nullopt;
  Place place{*offset, *heads, 0, 0, {}, {}};
  if (!ReadGrid(json, place)) return std::nullopt;
  for (const auto& key : keys) {
    if (!key.is_string()) return std::nullopt;
    place.keys.push_back(key.get<std::string>());
  }
  for (const auto& largest : scale) {
    if (!largest.is_number()) return std::nullopt;
    place.scale.push_back(largest.get<double>());
  }
  return place;
}

ModuleAttention AttentionAt(const Place& place, std::span<const std::uint8_t> bytes) {
  const HeadAttention none{std::vector<double>(place.tokens()), std::vector<double>(place.keys.size())};
  ModuleAttention attention{static_cast<int>(place.rows), static_cast<int>(place.columns), place.keys, none, {}};
  const double part = 1.0 / static_cast<double>(place.heads);
  for (std::size_t h = 0; h < place.heads; ++h) {
    const auto own = bytes.subspan(place.offset + h * place.weights(), place.weights());
    HeadAttention& head = attention.heads.emplace_back(none);
    for (std::size_t k = 0; k < own.size(); ++k) {
      const bool seen = k < place.tokens();
      const std::size_t at = seen ? k : k - place.tokens();
      const double weight = place.scale[h] * own[k] / 255;
      (seen ? head.picture : head.keys)[at] = weight;
      (seen ? attention.mean.picture : attention.mean.keys)[at] += part * weight;
    }
  }
  return attention;
}

Status ReadAttention(const bus::Insight& message, Insight& insight) {
  const auto layout = ParseBoundedJson(message.attention_json);
  if (!layout || !layout->is_object()) return Fail(Code::kCorrupt, "read an insight: its attention has no layout");
  std::size_t left = message.attention.size();  // each module has bytes of its own
  for (const auto& [module, json] : layout->items()) {
    const auto place = PlaceOf(json);
    if (!place || !place->Fits(message.attention.size()) || place->heads * place->weights() > left)
      return Fail(Code::kCorrupt, fmt::format("read an insight: the attention of {} does not fit its {} bytes", module,
                                              message.attention.size()));
    left -= place->heads * place->weights();
    insight.attention[module] = AttentionAt(*place, message.attention);
  }
  return {};
}

// Nothing where nothing is said.
Status ReadWorth(const std::string& text, Insight& insight) {
  if (text.empty()) return {};
  const auto bad = [] {
    return Fail(Code::kCorrupt, "read an insight: what words and joints are worth is not said so");
  };
  const auto said = text.size() <= kMostWorth ? ParseBoundedJson(text) : std::nullopt;
  if (!said || !said->is_object()) return bad();
  const OrderedJson &words = Member(*said, "words"), &joints = Member(*said, "joints");
  if (!words.is_array() || !joints.is_array()) return bad();
  for (const auto& one : words) {
    if (!one.is_object()) return bad();
    const OrderedJson &word = Member(one, "word"), &moves = Member(one, "moves");
    if (!word.is_string() || !moves.is_number()) return bad();
    insight.words.push_back({word.get<std::string>(), moves.get<double>()});
  }
  for (const auto& moves : joints) {
    if (!moves.is_number()) return bad();
    insight.joints.push_back(moves.get<double>());
  }
  return {};
}

Result<std::vector<Waypoint>> ReadWaypoints(const std::vector<float>& numbers) {
  if (numbers.empty()) return std::vector<Waypoint>();
  if (!AreWaypoints(numbers))
    return Fail(Code::kCorrupt,
                fmt::format("read an insight: {} numbers are no {} finite waypoints", numbers.size(), kWaypoints));
  return WaypointsOf(numbers);
}

}  // namespace

double ModuleAttention::share() const { return std::accumulate(mean.picture.begin(), mean.picture.end(), 0.0); }

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
  ETUDE_RETURN_IF_ERROR(ReadWorth(message.worth_json, insight));
  const auto& view = message.view;
  if (!view.empty() && (view.size() != 4 || std::ranges::any_of(view, [](auto side) { return side > kMostSide; })))
    return Fail(Code::kCorrupt, "read an insight: its view is no part of a picture");
  if (!view.empty())
    insight.view = {static_cast<int>(view[0]), static_cast<int>(view[1]), static_cast<int>(view[2]),
                    static_cast<int>(view[3])};
  ETUDE_ASSIGN_OR_RETURN(insight.waypoints, ReadWaypoints(message.waypoints));
  ETUDE_ASSIGN_OR_RETURN(insight.what_if_waypoints, ReadWaypoints(message.what_if_waypoints));
  return insight;
}

}  // namespace etude::policy
