// SPDX-License-Identifier: Apache-2.0
#include "services/policy/insight_file.h"

#include <fcntl.h>
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <span>
#include <type_traits>

#include "services/codec/deflate.h"
#include "services/episode/bounded_json.h"
#include "services/policy/conversion.h"

namespace etude::policy {
namespace {

constexpr const char* kInsightFormat = "etude-insights-1";
constexpr std::size_t kMostIndexLine = 1 << 20;  // bytes: kMostKeptDecisions of some 60 and more

constexpr std::ptrdiff_t kMostText = 1 << 20;  // bytes: what is parsed takes many times as much

using Bytes = std::vector<std::uint8_t>;

// ---- an insight as a block ------------------------------------------------------------------------

// One byte a weight, 255 for the largest. @returns what 255 means
double AppendWeights(const HeadAttention& head, Bytes& bytes) {
  double largest = 0;
  for (const auto* weights : {&head.picture, &head.keys})
    for (const double weight : *weights)
      if (std::isfinite(weight)) largest = std::max(largest, weight);
  for (const auto* weights : {&head.picture, &head.keys})
    for (const double weight : *weights)
      bytes.push_back(std::isfinite(weight) && weight > 0
                          ? static_cast<std::uint8_t>(std::lround(255 * weight / largest))
                          : std::uint8_t{0});
  return largest;
}

OrderedJson LayoutOf(const Insight& insight, Bytes& bytes) {
  OrderedJson layout = OrderedJson::object();
  for (const auto& [module, attention] : insight.attention) {
    OrderedJson& place = layout[module] = {{"offset", bytes.size()}, {"heads", attention.heads.size()}};
    if (attention.reads_picture()) place["image"] = {attention.rows, attention.columns};
    place["keys"] = attention.keys;
    place["scale"] = OrderedJson::array();
    for (const auto& head : attention.heads) place["scale"].push_back(AppendWeights(head, bytes));
  }
  return layout;
}

Bytes BlockOf(const Insight& insight) {
  Bytes weights;
  OrderedJson json{{"checkpoint_step", insight.checkpoint_step},
                   {"modules", insight.modules},
                   {"attention", LayoutOf(insight, weights)}};
  const View& view = insight.view;
  if (view != View{}) json["view"] = {view.u, view.v, view.width, view.height};
  // a network may say a rotation that is none: the rest of the decision is what tells why
  std::vector<float> waypoints;
  for (const auto& waypoint : insight.waypoints)
    for (const float number : ToVector(waypoint)) waypoints.push_back(number);
  json["waypoints"] = AreWaypoints(waypoints) ? OrderedJson(waypoints) : OrderedJson::array();
  const std::string text = JsonText(json) + "\n";
  if (text.size() > kMostText) return {};
  Bytes block(text.begin(), text.end());
  block.insert(block.end(), weights.begin(), weights.end());
  return block;
}

// A list of numbers; nothing where it is something else.
template <class Number>
std::optional<std::vector<Number>> KeptList(const OrderedJson& json, const char* key) {
  std::vector<Number> numbers;
  const auto list = json.find(key);
  if (list == json.end()) return numbers;
  if (!list->is_array()) return std::nullopt;
  for (const auto& one : *list) {
    if (!one.is_number()) return std::nullopt;
    const double number = one.template get<double>();
    if (!(number <= 1e9 && number >= (std::is_integral_v<Number> ? 0 : -1e9))) return std::nullopt;
    numbers.push_back(static_cast<Number>(number));
  }
  return numbers;
}

std::uint64_t KeptUnsigned(const OrderedJson& json, const char* key) {
  const auto number = json.find(key);
  return number != json.end() && number->is_number_unsigned() ? number->get<std::uint64_t>() : 0;
}

// As the message that it once was, which ReadInsight checks.
Result<Insight> InsightOf(const Bytes& block, const std::string& where) {
  const auto bad = [&](const char* what) { return Fail(Code::kCorrupt, fmt::format("{}: {}", where, what)); };
  const auto end = std::ranges::find(block, '\n');
  if (end == block.end()) return bad("its text has no end");
  if (end - block.begin() > kMostText) return bad("its text is too long");
  const auto json =
      ParseBoundedJson({reinterpret_cast<const char*>(block.data()), static_cast<std::size_t>(end - block.begin())});
  if (!json || !json->is_object() || !json->contains("modules") || !json->contains("attention"))
    return bad("it is no insight");
  bus::Insight message;
  message.checkpoint_step = KeptUnsigned(*json, "checkpoint_step");
  message.modules_json = JsonText((*json)["modules"]);
  message.attention_json = JsonText((*json)["attention"]);
  message.attention.assign(end + 1, block.end());
  const auto view = KeptList<std::uint32_t>(*json, "view");
  const auto waypoints = KeptList<float>(*json, "waypoints");
  if (!view || !waypoints) return bad("its view or its waypoints are no numbers");
  message.view = *view;
  message.waypoints = *waypoints;
  auto insight = ReadInsight(message);
  if (!insight) return Fail(insight.error().Wrap(where));
  return insight;
}

OrderedJson IndexLine(const InsightsOf& of, OrderedJson decisions) {
  return {{"format", kInsightFormat},
          {"index", of.index},
          {"seed", std::to_string(of.seed)},
          {"attempt", of.attempt},
          {"decisions", std::move(decisions)}};
}

}  // namespace

std::string InsightFileName(std::uint64_t index) { return fmt::format("{:06}.insights", index); }

Result<std::size_t> WriteInsightFile(const Path& path, const InsightsOf& of, const InsightsByStep& insights) {
  OrderedJson decisions = OrderedJson::array();
  Bytes blocks;
  std::size_t kept = 0;
  for (const auto& [step, insight] : insights) {
    if (decisions.size() >= kMostKeptDecisions) break;
    const Bytes block = insight ? BlockOf(*insight) : Bytes{};
    Bytes deflated = block.empty() || block.size() > kMostInsight ? Bytes{} : codec::Deflate(block);
    if (blocks.size() + deflated.size() + kMostIndexLine > kMostInsightFile) deflated.clear();
    decisions.push_back(
        {{"step", step}, {"bytes", deflated.size()}, {"size", deflated.empty() ? std::size_t{0} : block.size()}});
    kept += deflated.empty() ? 0 : 1;
    blocks.insert(blocks.end(), deflated.begin(), deflated.end());
  }
  const std::string line = JsonText(IndexLine(of, std::move(decisions))) + "\n";
  blocks.insert(blocks.begin(), line.begin(), line.end());
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(path, blocks));
  return kept;
}

Result<InsightFile> InsightFile::Open(const Path& path) {
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file) return Fail(ErrnoError("open", path, errno));
  return Open(std::move(file), path);
}

Result<InsightFile> InsightFile::Open(Descriptor file, const Path& path) {
  InsightFile opened(std::move(file), path);
  ETUDE_RETURN_IF_ERROR(opened.ReadIndex());
  return opened;
}

Status InsightFile::ReadIndex() {
  const auto bad = [&](const char* what) {
    return Fail(Code::kCorrupt, fmt::format("read the insights '{}': {}", path_.string(), what));
  };
  Bytes line(kMostIndexLine);
  ETUDE_ASSIGN_OR_RETURN(const std::size_t read, ReadAt(file_.get(), path_, 0, line));
  line.resize(read);
  const auto end = std::ranges::find(line, '\n');
  if (end == line.end()) return bad("the first line has no end");
  std::uint64_t offset = static_cast<std::uint64_t>(end - line.begin()) + 1;
  const auto json = ParseBoundedJson({reinterpret_cast<const char*>(line.data()), offset - 1});
  if (!json || !json->is_object() || json->value("format", OrderedJson()) != kInsightFormat)
    return bad("this program knows no such file");
  const auto seed = json->find("seed"), decisions = json->find("decisions");
  if (seed == json->end() || !seed->is_string() || decisions == json->end() || !decisions->is_array() ||
      decisions->size() > kMostKeptDecisions)
    return bad("its first line does not say what it holds");
  const auto& digits = seed->get_ref<const std::string&>();
  std::from_chars(digits.data(), digits.data() + digits.size(), of_.seed);
  of_.index = KeptUnsigned(*json, "index");
  of_.attempt = static_cast<std::uint32_t>(KeptUnsigned(*json, "attempt"));
  for (const auto& one : *decisions) {
    if (!one.is_object()) return bad("a decision is none");
    const auto step = KeptUnsigned(one, "step"), bytes = KeptUnsigned(one, "bytes"), size = KeptUnsigned(one, "size");
    if (step > (1u << 30) || size > kMostInsight || bytes > 2 * kMostInsight || (bytes == 0) != (size == 0))
      return bad("a decision is out of bounds");
    decisions_.push_back({static_cast<int>(step), offset, bytes, size});
    offset += bytes;
  }
  return offset <= kMostInsightFile + kMostIndexLine ? Status() : bad("it is too large");
}

Result<Insight> InsightFile::At(std::size_t decision) const {
  if (decision >= decisions_.size() || !decisions_[decision].kept())
    return Fail(Code::kNotFound, decision < decisions_.size()
                                     ? fmt::format("decision {} has no insight", decision)
                                     : fmt::format("the rollout has {} decisions", decisions_.size()));
  const Decision& place = decisions_[decision];
  const std::string where = fmt::format("read decision {} of '{}'", decision, path_.string());
  Bytes deflated(place.bytes), block(place.size);
  ETUDE_ASSIGN_OR_RETURN(const std::size_t read, ReadAt(file_.get(), path_, place.offset, deflated));
  if (read < deflated.size()) return Fail(Code::kCorrupt, where + ": the file is cut short");
  if (const Status inflated = codec::Inflate(deflated, block); !inflated) return Fail(inflated.error().Wrap(where));
  return InsightOf(block, where);
}

}  // namespace etude::policy
