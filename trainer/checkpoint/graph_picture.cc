// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/graph_picture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"

namespace etude::checkpoint {
namespace {

using policy::ModuleConfig;

std::set<std::string> FrozenParts(const Metadata& metadata) {
  const OrderedJson::json_pointer where("/init/freeze");
  const auto& config = metadata.train_config;
  if (!config.is_object() || !config.contains(where) || !config[where].is_array()) return {};
  std::set<std::string> frozen;
  for (const auto& name : config[where])
    if (name.is_string()) frozen.insert(name.get<std::string>());
  return frozen;
}

// "target.position, m: mlp 256-128"
std::string SaysText(const ModuleConfig& module) {
  const auto* quantity = policy::QuantityOf(module);
  if (!quantity) return "nothing: its register alone";
  const auto& decoder = module.decoder;
  std::string unit(quantity->unit());
  return fmt::format("{}{}: {}{}{}", decoder.label(), unit == "-" ? "" : ", " + unit, decoder.readout,
                     decoder.hidden.empty() ? "" : fmt::format(" {}", fmt::join(decoder.hidden, "-")),
                     decoder.from.empty() ? "" : fmt::format(" of {}", fmt::join(decoder.from, ", ")));
}

// "1161 steps, 0.21 cm"; "" when nothing is known
std::string ProgressText(const ModuleConfig& module, const Metadata& metadata) {
  const auto record = metadata.modules.find(module.name);
  if (record == metadata.modules.end()) return "";
  std::string text = fmt::format("{} steps", record->second.trained_steps);
  if (!record->second.error) return text + ", never measured";
  const double error = *record->second.error;
  const auto* quantity = policy::QuantityOf(module);
  const std::string unit = quantity ? std::string(quantity->unit()) : "-";
  if (unit == "-") return fmt::format("{}, {:.2f} % right", text, 100 * (1 - error));
  return unit == "m" ? fmt::format("{}, {:.2f} cm", text, 100 * error)
                     : fmt::format("{}, {:.2f} {}", text, error, unit);
}

std::string Title(const Metadata& metadata) {
  const auto& config = metadata.policy;
  std::string title =
      fmt::format("{}: {} modules, width {}, {} heads", config.name, config.modules.size(), config.width, config.heads);
  if (metadata.run.empty()) return title;
  return fmt::format("{}; run {} step {}, robot {}, {} demonstrations", title, metadata.run, metadata.step,
                     metadata.embodiment.robot.empty() ? "?" : metadata.embodiment.robot, metadata.train_episodes);
}

std::string Escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '<')
      result += "&lt;";
    else if (c == '&')
      result += "&amp;";
    else if (c == '"')
      result += "&quot;";
    else
      result += c;
  }
  return result;
}

/// The drawing, box by box and arrow by arrow.
class Drawing {
 public:
  explicit Drawing(const Metadata& metadata) : metadata_(metadata), frozen_(FrozenParts(metadata)) {
    for (const char* encoder : {"image", "language", "joints"}) Place(encoder, 0);
    std::map<int, int> columns;
    for (const ModuleConfig* module : policy::EvaluationOrder(metadata.policy)) {
      const int next = static_cast<int>(columns.size()) + 1;
      Place(module->name, columns.emplace(module->level, next).first->second);
    }
  }

  std::string Text() {
    for (const ModuleConfig& module : metadata_.policy.modules) DrawArrows(module);
    DrawBox("image", {"picture, crop " + CropText()});
    const auto& language = metadata_.policy.language;
    DrawBox("language", {"sentence, " + (language.clip_folder().empty() ? language.encoder : "clip")});
    DrawBox("joints", {metadata_.policy.joint_fourier ? "angles, sine and cosine" : "angles"});
    for (const ModuleConfig& module : metadata_.policy.modules)
      DrawBox(module.name,
              {SaysText(module), ProgressText(module, metadata_) + (module.own_image ? " (own image encoder)" : "")});
    int width = 0, height = 0;
    for (const auto& [name, place] : places_) {
      width = std::max(width, place.x + kWidth + kMargin);
      height = std::max(height, place.y + kHeight + kMargin);
    }
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
        "font-family=\"sans-serif\" font-size=\"11\">\n"
        "<defs><pattern id=\"frozen\" width=\"6\" height=\"6\" patternUnits=\"userSpaceOnUse\" "
        "patternTransform=\"rotate(45)\"><rect width=\"6\" height=\"6\" fill=\"#eef3f8\"/>"
        "<path d=\"M0 0V6\" stroke=\"#b9cde0\" stroke-width=\"2\"/></pattern></defs>\n"
        "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
        "<text x=\"{2}\" y=\"24\" font-size=\"14\" font-weight=\"bold\">{3}</text>\n{4}{5}"
        "<text x=\"{2}\" y=\"{6}\" fill=\"#555555\">strong: supervised attention; thin: read; dashed: query; hatched: "
        "frozen</text>\n</svg>\n",
        width, height + 2 * kMargin, kMargin, Escaped(Title(metadata_)), arrows_, boxes_, height + kMargin);
  }

 private:
  static constexpr int kWidth = 210, kHeight = 62, kColumn = 290, kRow = 92, kMargin = 20, kTop = 50;
  struct Spot {
    int x = 0, y = 0, column = 0;
  };

  void Place(const std::string& name, int column) {
    places_[name] = {kMargin + column * kColumn, kTop + rows_[column]++ * kRow, column};
  }

  std::string CropText() const {
    const auto& crop = metadata_.policy.image.crop;
    return crop.size() == 4 ? fmt::format("{}x{} px", crop[2], crop[3]) : "from the camera";
  }

  void DrawArrow(const std::string& from, const std::string& to, const char* style) {
    const auto source = places_.find(from), target = places_.find(to);
    if (source == places_.end() || target == places_.end()) return;
    const Spot &a = source->second, &b = target->second;
    const bool beside = a.column == b.column;  // read by one of its own level: round the left side
    const int x1 = beside ? a.x : a.x + kWidth, y1 = a.y + kHeight / 2, x2 = b.x, y2 = b.y + kHeight / 2;
    const int bend = beside ? -30 : (x2 - x1) / 2;
    arrows_ += fmt::format("<path d=\"M{} {}C{} {} {} {} {} {}\" fill=\"none\" {}/>\n", x1, y1, x1 + bend, y1,
                           beside ? x2 - 30 : x2 - bend, y2, x2, y2, style);
  }

  void DrawArrows(const ModuleConfig& module) {
    std::set<std::string> attended;
    if (module.attend_weight > 0)
      for (const auto& item : module.attend) attended.insert(item.substr(0, item.find('@')));
    for (const auto& part : policy::ReadParts(metadata_.policy, module))
      if (!attended.contains(part) && part != module.query)
        DrawArrow(part, module.name, "stroke=\"#c4c4c4\" stroke-width=\"1\"");
    if (!module.query.empty())
      DrawArrow(module.query, module.name, "stroke=\"#7a5195\" stroke-width=\"1.5\" stroke-dasharray=\"5 3\"");
    for (const auto& part : attended) DrawArrow(part, module.name, "stroke=\"#1f77b4\" stroke-width=\"2.5\"");
  }

  void DrawBox(const std::string& name, const std::vector<std::string>& lines) {
    const Spot& place = places_.at(name);
    const bool frozen = frozen_.contains(name);
    boxes_ += fmt::format(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"7\" fill=\"{}\" stroke=\"#333333\"/>\n"
        "<text x=\"{}\" y=\"{}\" font-size=\"13\" font-weight=\"bold\">{}{}</text>\n",
        place.x, place.y, kWidth, kHeight, frozen ? "url(#frozen)" : "#fdf6e9", place.x + 10, place.y + 20,
        Escaped(name), frozen ? " (frozen)" : "");
    int y = place.y + 37;
    for (const auto& line : lines) {
      constexpr std::size_t kMost = 36;  // characters that fit
      const std::string shown = line.size() > kMost ? line.substr(0, kMost - 1) + "…" : line;
      boxes_ += fmt::format("<text x=\"{}\" y=\"{}\">{}</text>\n", place.x + 10, y, Escaped(shown));
      y += 16;
    }
  }

  const Metadata& metadata_;
  std::set<std::string> frozen_;
  std::map<std::string, Spot> places_;
  std::map<int, int> rows_;  // boxes so far, by column
  std::string arrows_, boxes_;
};

}  // namespace

std::string GraphText(const Metadata& metadata) {
  const auto frozen = FrozenParts(metadata);
  std::string text = Title(metadata) + "\n";
  int level = 0;
  for (const ModuleConfig* module : policy::EvaluationOrder(metadata.policy)) {
    if (module->level != level) text += fmt::format("\nlevel {}\n", level = module->level);
    text += fmt::format("  {}{}\n", module->name, frozen.contains(module->name) ? "  (frozen)" : "");
    const auto line = [&](const char* what, const std::string& said) {
      if (!said.empty()) text += fmt::format("    {:<9}{}\n", what, said);
    };
    line("query", module->query.empty() ? "its own register" : module->query);
    line("reads", fmt::format("{}{}", fmt::join(policy::ResolveReads(metadata.policy, *module), ", "),
                              module->own_image ? " (the image through an encoder of its own)" : ""));
    if (module->attend_weight > 0) line("attends", fmt::format("{}", fmt::join(module->attend, " + ")));
    line("says", SaysText(*module));
    if (policy::QuantityOf(*module)) line("from", fmt::format("{}", fmt::join(module->decoder.inputs, ", ")));
    line("trained", ProgressText(*module, metadata));
  }
  // encoders, and with shared attention the levels'
  std::vector<std::string> others(frozen.begin(), frozen.end());
  std::erase_if(others, [&](const std::string& part) { return policy::FindModule(metadata.policy, part) != nullptr; });
  if (!others.empty()) text += fmt::format("\nfrozen beside the modules: {}\n", fmt::join(others, ", "));
  return text;
}

std::string GraphSvg(const Metadata& metadata) { return Drawing(metadata).Text(); }

}  // namespace etude::checkpoint
