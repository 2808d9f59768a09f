// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/insight_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "services/core/config.h"
#include "services/core/printable.h"
#include "services/episode/action.h"
#include "services/episode/bounded_json.h"

namespace etude::serve {
namespace {

// "pepsi (0.97)" or "[0.103, 0.312, 0.040] m"
std::string ValueText(const OrderedJson& said) {
  if (!said.is_object() || !said.contains("value")) return "";
  const auto& value = said["value"];
  std::string text;
  if (value.is_array()) {
    std::vector<std::string> numbers;
    for (const auto& x : value) numbers.push_back(x.is_number() ? fmt::format("{:.3f}", x.get<double>()) : "-");
    text = fmt::format("[{}]", fmt::join(numbers, ", "));
  } else {
    text = value.is_string() ? value.get<std::string>() : value.dump();
  }
  if (said.contains("probability") && said["probability"].is_number())
    text += fmt::format(" ({:.2f})", said["probability"].get<double>());
  if (said.contains("unit") && said["unit"].is_string() && said["unit"] != "-")
    text += " " + said["unit"].get<std::string>();
  return Printable(text);
}

// What Insight::attention_json says of one module, held against the bytes that there are.
struct AttentionPlace {
  std::size_t offset = 0, rows = 0, columns = 0;
  std::vector<std::string> keys;  ///< behind the picture's patches
  std::vector<double> scale;      ///< of each head

  std::size_t patches() const { return rows * columns; }
  std::size_t size() const { return patches() + keys.size(); }
};

std::optional<AttentionPlace> ReadPlace(const OrderedJson& layout, const std::string& module, std::size_t bytes) {
  if (!layout.is_object() || !layout.contains(module) || !layout[module].is_object()) return std::nullopt;
  const OrderedJson& said = layout[module];
  AttentionPlace place;
  try {
    place.offset = said.at("offset").get<std::uint32_t>();
    if (said.contains("image")) place.rows = said["image"].at(0).get<std::uint16_t>();
    if (said.contains("image")) place.columns = said["image"].at(1).get<std::uint16_t>();
    place.keys = said.at("keys").get<std::vector<std::string>>();
    place.scale = said.at("scale").get<std::vector<double>>();
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
  const bool fits = place.size() > 0 && !place.scale.empty() && place.offset <= bytes &&
                    place.scale.size() <= (bytes - place.offset) / place.size();
  return fits ? std::optional(place) : std::nullopt;
}

// "looks at patch (12, 7)  picture 0.82  language 0.10  joints 0.00  modules 0.08", the mean over its heads
std::string AttentionText(const AttentionPlace& place, const std::vector<std::uint8_t>& bytes) {
  std::vector<double> mean(place.size());
  for (std::size_t head = 0; head < place.scale.size(); ++head)
    for (std::size_t k = 0; k < place.size(); ++k)
      mean[k] += bytes[place.offset + head * place.size() + k] / 255.0 * place.scale[head] /
                 static_cast<double>(place.scale.size());
  double picture = 0, language = 0, joints = 0, modules = 0;
  for (std::size_t k = 0; k < place.patches(); ++k) picture += mean[k];
  for (std::size_t k = 0; k < place.keys.size(); ++k) {
    double& mass = place.keys[k] == "language" ? language : place.keys[k] == "joints" ? joints : modules;
    mass += mean[place.patches() + k];
  }
  std::string text;
  if (place.patches() > 0) {
    const auto last = mean.begin() + static_cast<std::ptrdiff_t>(place.patches());
    const auto best = static_cast<std::size_t>(std::max_element(mean.begin(), last) - mean.begin());
    text = fmt::format("looks at patch ({}, {})  ", best % place.columns, best / place.columns);
  }
  return text + fmt::format("picture {:.2f}  language {:.2f}  joints {:.2f}  modules {:.2f}", picture, language, joints,
                            modules);
}

bool ArePlanned(const std::vector<float>& waypoints) { return waypoints.size() == kWaypoints * kWaypointSize; }

// "  waypoints first [...] m last [...] m", and how far they would move
std::string PlanText(const bus::Insight& insight) {
  const auto& now = insight.waypoints;
  const auto& other = insight.what_if_waypoints;
  if (!ArePlanned(now)) return "";
  const float* last = now.data() + (kWaypoints - 1) * kWaypointSize;
  std::string text = fmt::format("  {:<9} first [{:.3f}, {:.3f}, {:.3f}] m  last [{:.3f}, {:.3f}, {:.3f}] m",
                                 "waypoints", now[0], now[1], now[2], last[0], last[1], last[2]);
  if (!ArePlanned(other)) return text + "\n";
  double largest = 0;
  int flips = 0;
  for (std::size_t i = 0; i < now.size(); i += kWaypointSize) {
    largest =
        std::max<double>(largest, std::hypot(now[i] - other[i], now[i + 1] - other[i + 1], now[i + 2] - other[i + 2]));
    flips += (now[i + kWaypointSize - 1] > 0.5F) != (other[i + kWaypointSize - 1] > 0.5F);
  }
  return text + fmt::format("   instead up to {:.1f} cm elsewhere, gripper changed at {} of {}\n", 100 * largest, flips,
                            kWaypoints);
}

// "  waypoints move, cm, without: push 1.2, the 0.0; joints 0.1, 0.0"
std::string WorthLine(const std::string& worth_json) {
  const auto worth = ParseBoundedJson(worth_json);
  if (!worth || !worth->is_object()) return "";
  std::vector<std::string> words, joints;
  try {
    for (const auto& word : worth->at("words"))
      words.push_back(fmt::format("{} {:.1f}", Printable(word.at("word").get<std::string>()),
                                  100 * word.at("moves").get<double>()));
    for (const auto& joint : worth->at("joints")) joints.push_back(fmt::format("{:.1f}", 100 * joint.get<double>()));
  } catch (const nlohmann::json::exception&) {
    return "";
  }
  return fmt::format("  waypoints move, cm, without: {}; joints {}\n", fmt::join(words, ", "), fmt::join(joints, ", "));
}

OrderedJson InsightJson(const bus::Insight& insight) {
  const auto parsed = [](const std::string& text) { return ParseBoundedJson(text).value_or(OrderedJson()); };
  return {{"run", insight.run},
          {"run_id", insight.run_id},
          {"viewer", insight.viewer},
          {"session", insight.session},
          {"request", insight.request_id},
          {"step", insight.checkpoint_step},
          {"sha256", insight.checkpoint_sha256},
          {"instruction", insight.instruction},
          {"modules", parsed(insight.modules_json)},
          {"what_if", parsed(insight.what_if_json)},
          {"waypoints", insight.waypoints},
          {"what_if_waypoints", insight.what_if_waypoints},
          {"worth", parsed(insight.worth_json)},
          {"attention_layout", parsed(insight.attention_json)},
          {"attention", insight.attention},
          {"view", insight.view},
          {"width", insight.width},
          {"height", insight.height},
          {"picture", insight.picture}};
}

}  // namespace

std::string InsightLine(const bus::Insight& insight) { return JsonText(InsightJson(insight)); }

std::string InsightText(const bus::Insight& insight) {
  const auto modules = ParseBoundedJson(insight.modules_json), changed = ParseBoundedJson(insight.what_if_json);
  const OrderedJson layout = ParseBoundedJson(insight.attention_json).value_or(OrderedJson());
  std::string text;
  if (!modules || !modules->is_object()) return text;
  for (const auto& [name, said] : modules->items()) {
    const auto word = [&, &said = said](const char* key) {
      return said.is_object() && said.contains(key) && said[key].is_string() ? said[key].get<std::string>() : "";
    };
    text +=
        fmt::format("  {:<9} {:<22} {}", Printable(name),
                    word("entity").empty() ? "" : Printable(word("entity") + "." + word("quantity")), ValueText(said));
    // a trajectory says no value: see PlanText
    if (said.is_object() && said.contains("value") && changed && changed->is_object() && changed->contains(name)) {
      const std::string now = ValueText((*changed)[name]);
      text += now == ValueText(said) ? "   the same" : "   instead " + now;
    }
    if (const auto place = ReadPlace(layout, name, insight.attention.size()))
      text += "   " + AttentionText(*place, insight.attention);
    text += "\n";
  }
  return text + PlanText(insight) + WorthLine(insight.worth_json);
}

}  // namespace etude::serve
