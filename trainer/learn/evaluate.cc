// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string_view>

#include "services/core/log.h"
#include "services/core/rng.h"
#include "services/episode/viewpoint.h"
#include "services/language/held_out.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/loss.h"
#include "trainer/policy/names.h"

namespace etude::learn {
namespace {

using torch::indexing::Slice;

struct Sum {
  double sum = 0, count = 0, scale = 1;
  policy::Metric::Role role = policy::Metric::Role::kExtra;

  double Mean() const { return sum / count; }
};

// metrics of many batches, by name
class Sums {
 public:
  // adds the values where they are valid (broadcast to their shape)
  void Add(const std::string& name, const policy::Metric& metric) {
    const auto mask = metric.valid.expand(metric.values.sizes());
    const auto values = metric.values.to(torch::kFloat64);
    Sum& sum = sums_[name];
    sum.sum += torch::where(mask, values, torch::zeros({}, values.options())).sum().item<double>();
    sum.count += mask.sum().item<double>();
    sum.scale = metric.scale;
    sum.role = metric.role;
  }
  const std::map<std::string, Sum>& all() const { return sums_; }

 private:
  std::map<std::string, Sum> sums_;
};

// As the policy is used, not as it is trained; also where torch throws.
class Evaluating {
 public:
  explicit Evaluating(policy::Policy& policy) : policy_(policy) { policy_.eval(); }
  ~Evaluating() { policy_.train(); }
  Evaluating(const Evaluating&) = delete;
  Evaluating& operator=(const Evaluating&) = delete;

 private:
  policy::Policy& policy_;
};

// what its quantity measures
void AddDecoder(const policy::PolicyConfig& config, const policy::ModuleConfig& module,
                const policy::ModuleOutput& output, const policy::Labels& labels, Sums& sums) {
  const policy::Quantity* quantity = policy::QuantityOf(module);
  if (quantity == nullptr) return;
  const policy::Target target = policy::FindTarget(labels, module.decoder.label());
  if (!target.value.defined()) return;
  for (const auto& metric : quantity->Measure(policy::HeadOf(config, module), output, target))
    sums.Add(module.name + "." + metric.name, metric);
}

// Is the most attended image token the one that shows the label's pixel? Of a set: the pixel of any member; where none
// is in the picture there is no right place.
void AddAttention(const policy::ModuleConfig& module, const policy::ModuleOutput& output, const policy::Inputs& inputs,
                  const policy::Labels& labels, const policy::TokenGrid& grid, Sums& sums) {
  std::string entity;
  for (const std::string& item : module.attend)
    if (entity.empty()) entity = policy::AttendedEntity(item);
  if (entity.empty() || !output.attention.defined()) return;
  const policy::Target target = policy::FindTarget(labels, entity + ".pixel");
  if (!target.value.defined()) return;
  const int rows = grid.rows, columns = grid.columns;
  if (output.attention.size(-1) < static_cast<std::int64_t>(rows) * columns) return;
  const auto best = output.attention.index({"...", Slice(0, rows * columns)}).argmax(-1);
  // (B, S, members, 2)
  const bool set = target.value.dim() == 4;
  const auto pixel = set ? target.value : target.value.unsqueeze(2);
  const auto in_crop = pixel - inputs.crop_origin.unsqueeze(1).unsqueeze(1);
  // as the loss has it: the last tokens may stand over the picture's edge
  const auto column = (in_crop.index({"...", 0}) / grid.stride).floor(),
             row = (in_crop.index({"...", 1}) / grid.stride).floor();
  const auto inside =
      (set ? target.valid : target.valid.unsqueeze(2)) & (column >= 0) & (column < columns) & (row >= 0) & (row < rows);
  const auto hit = (inside & (best.unsqueeze(2) == (row * columns + column).to(torch::kInt64))).any(2);
  sums.Add(module.name + ".hit", {"hit", hit, set ? inside.any(2) : target.valid, 1, policy::Metric::Role::kAccuracy});
}

Evaluation Summarize(const policy::PolicyConfig& config, const Sums& sums) {
  Evaluation result;
  for (const auto& [name, sum] : sums.all())
    if (sum.count > 0) result.metrics[name] = sum.scale * sum.Mean();
  // a module's error is its quantity's; of one that decodes nothing, where it looks
  using Role = policy::Metric::Role;
  for (const auto& module : config.modules) {
    const auto own = [&](const auto& item) {
      return item.second.role != Role::kExtra && item.second.count > 0 && item.first.starts_with(module.name + ".");
    };
    const std::string hit = module.name + ".hit";
    const auto& all = sums.all();
    auto found = std::find_if(all.begin(), all.end(), [&](const auto& item) { return own(item) && item.first != hit; });
    if (found == all.end()) found = std::find_if(all.begin(), all.end(), own);
    if (found == all.end()) continue;
    const double mean = found->second.Mean();
    result.errors[module.name] = found->second.role == Role::kAccuracy ? 1 - mean : mean;
  }
  return result;
}

// the module at level 1 that says `label` of a sentence, if there is one
const policy::ModuleConfig* LanguageModule(const policy::PolicyConfig& config, std::string_view label) {
  for (const auto& module : config.modules) {
    const bool looks = std::any_of(module.reads.begin(), module.reads.end(),
                                   [](const std::string& read) { return read == "image" || read == "all"; });
    if (module.level == 1 && module.decoder.label() == label && !looks) return &module;
  }
  return nullptr;
}

// sentences, and the object and the task that each means
struct Asked {
  std::vector<std::string> sentences, objects, tasks;

  void Add(std::string sentence, const std::string& object, const std::string& task) {
    sentences.push_back(std::move(sentence));
    objects.push_back(object);
    tasks.push_back(task);
  }
};

// fraction of the sentences of which the module says what they mean, by its place in `names`; of those alone that mean
// something of it
std::optional<double> Accuracy(policy::Policy& policy, const policy::ModuleConfig& module,
                               const std::vector<std::string>& sentences, const std::vector<std::string>& meant,
                               const std::vector<std::string>& names) {
  if (sentences.empty()) return std::nullopt;
  const auto count = static_cast<std::int64_t>(sentences.size());
  policy::Inputs inputs;
  inputs.sentences = sentences;
  inputs.sentence_index = torch::arange(count).unsqueeze(0);
  // the arm may be anywhere; other modules of this level may look at the picture, and see nothing
  const auto crop = policy::CropOf(policy.config().image);
  inputs.images = torch::zeros({1, 3, crop.height, crop.width}, torch::kUInt8);
  inputs.joints = torch::zeros({1, policy.joints()});
  inputs.crop_origin = torch::zeros({1, 2});
  inputs.viewpoint = torch::zeros({1, kViewpointSize});
  const auto outputs = policy.Forward(inputs, 1);
  // one answer for all where the module reads no sentence
  const auto best = outputs.at(module.name).decoded.at(module.decoder.quantity).argmax(-1).expand({1, count});
  const auto said = best.flatten().to(torch::kCPU).contiguous();
  int right = 0, asked = 0;
  for (std::int64_t i = 0; i < count; ++i) {
    const std::string& name = meant[static_cast<std::size_t>(i)];
    if (std::ranges::find(names, name) == names.end()) continue;
    ++asked;
    right += names.at(static_cast<std::size_t>(said.data_ptr<std::int64_t>()[i])) == name;
  }
  if (asked == 0) return std::nullopt;
  return right / static_cast<double>(asked);
}

// Drawn for each of `tasks` and `objects`, from a seed of their own.
Asked DrawnSentences(const language::Grammar& grammar, const std::vector<std::string>& tasks,
                     const std::vector<std::string>& objects, language::Style style, bool clause) {
  constexpr int kEach = 12;
  Asked drawn;
  Rng rng(MixSeed({}, "evaluate language"));
  for (const auto& name : tasks) {
    const auto task = ParseTask(name);
    if (!task) continue;
    for (std::size_t k = 0; k < objects.size(); ++k) {
      const auto other = [&](std::size_t steps) { return objects[(k + steps) % objects.size()]; };
      auto command = language::CommandFor(*task, objects[k], task->relation() ? other(1) : "");
      for (int i = 0; i < kEach; ++i) {
        if (clause) command.obstacle = i % 2 == 0 ? language::kEverythingElse : other(2);
        if (grammar.Check(command)) drawn.Add(grammar.Sample(command, style, rng), command.target, command.task);
      }
    }
  }
  return drawn;
}

// By the part of the metric's name behind the module's.
std::map<std::string, Asked> AskedOf(const language::Grammar& grammar, const std::vector<std::string>& tasks,
                                     const std::vector<std::string>& objects) {
  const auto known = [&](const std::string& object) {
    return std::find(objects.begin(), objects.end(), object) != objects.end();
  };
  std::map<std::string, Asked> asked;
  const auto has = [&](const std::string& task) {
    return std::ranges::any_of(tasks, [&](const auto& text) { return text.substr(0, text.find('+')) == task; });
  };
  for (const auto& sentence : language::HeldOutSentences())
    if (known(sentence.object) && has(sentence.task))
      asked["unseen"].Add(sentence.text, sentence.object, sentence.task);
  for (const auto& phrase : language::HeldOutNounPhrases())
    if (known(phrase.object)) asked["phrases"].Add("push " + phrase.text, phrase.object, "push");
  asked["noisy"] = DrawnSentences(grammar, tasks, objects, language::Style::kNoisy, false);
  asked["clauses"] = DrawnSentences(grammar, tasks, objects, language::Style::kVaried, true);
  return asked;
}

}  // namespace

std::map<std::string, double> EvaluateLanguage(policy::Policy& policy, const language::Grammar& grammar,
                                               const std::vector<std::string>& tasks,
                                               const std::vector<std::string>& nouns) {
  const policy::PolicyConfig& config = policy.config();
  const auto* object = LanguageModule(config, "target.class");
  const auto* task = LanguageModule(config, "command.task");
  if (!object && !task) return {};
  const torch::NoGradGuard no_grad;
  const Evaluating evaluating(policy);
  std::map<std::string, double> metrics;
  const auto note = [&](const policy::ModuleConfig* module, const std::string& what, const auto& accuracy) {
    if (accuracy) metrics[module->name + "." + what] = *accuracy;
  };
  for (const auto& [what, asked] : AskedOf(grammar, tasks, nouns)) {
    if (object) note(object, what, Accuracy(policy, *object, asked.sentences, asked.objects, config.objects));
    // phrases are pushed
    const bool of_these =
        what != "phrases" || std::ranges::any_of(tasks, [](const auto& text) { return text.starts_with("push"); });
    if (task && of_these) note(task, what, Accuracy(policy, *task, asked.sentences, asked.tasks, config.tasks));
  }
  return metrics;
}

Status VisitBatches(policy::Policy& policy, const ValidationSet& set, const BatchVisitor& visit) {
  const auto& samples = set.samples;
  if (samples.empty()) return Fail(Code::kNotFound, "evaluate: the validation split has no frames");
  const torch::NoGradGuard no_grad;
  const Evaluating evaluating(policy);
  data::Batch arrays;
  data::FrameScratch scratch;
  Status status;
  std::size_t visited = 0, unreadable = 0;
  const auto left_out = [&](const Error& why) {
    if (++unreadable == 1) Log().warn("a validation picture that cannot be read is left out: {}", why.message);
  };
  for (std::size_t start = 0; start < samples.size() && status; start += static_cast<std::size_t>(set.batch)) {
    if (set.between) set.between();
    const std::size_t end = std::min(samples.size(), start + static_cast<std::size_t>(set.batch));
    std::vector<data::Sample> chunk(samples.begin() + static_cast<std::ptrdiff_t>(start),
                                    samples.begin() + static_cast<std::ptrdiff_t>(end));
    status = data::MakeReadable(set.maker, set.snapshot, 0, data::Augment::kNo, chunk, scratch, arrays, left_out);
    if (chunk.empty()) status = {};  // none of them is validated on
    if (!status) break;
    if (chunk.empty()) continue;
    visited += chunk.size();
    const Part part = PartOf(arrays, 0, arrays.size, policy.device());
    visit(chunk, part, policy.Forward(part.inputs, set.level));
  }
  if (!status) return Fail(status.error().Wrap("evaluate"));
  if (visited == 0)
    return Fail(Code::kUnavailable, fmt::format("evaluate: none of {} validation pictures can be read", unreadable));
  return {};
}

Result<Evaluation> Evaluate(policy::Policy& policy, const ValidationSet& set) {
  Sums sums;
  const policy::TokenGrid grid(policy.config().image);
  double loss = 0;
  std::size_t measured = 0;
  const auto measure = [&](const std::vector<data::Sample>& chunk, const Part& part, const policy::Outputs& outputs) {
    measured += chunk.size();
    loss += policy.Loss(part.inputs, outputs, part.labels, set.level).total.item<double>() *
            static_cast<double>(chunk.size());
    for (const auto& module : policy.config().modules) {
      const auto output = outputs.find(module.name);
      if (output == outputs.end()) continue;
      AddDecoder(policy.config(), module, output->second, part.labels, sums);
      AddAttention(module, output->second, part.inputs, part.labels, grid, sums);
    }
  };
  ETUDE_RETURN_IF_ERROR(VisitBatches(policy, set, measure));
  Evaluation result = Summarize(policy.config(), sums);
  result.metrics["loss"] = loss / static_cast<double>(measured);
  return result;
}

}  // namespace etude::learn
