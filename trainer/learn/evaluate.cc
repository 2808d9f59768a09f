// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/evaluate.h"

#include <fmt/format.h>

#include <algorithm>

#include "services/core/rng.h"
#include "services/episode/action.h"
#include "services/language/held_out.h"
#include "trainer/learn/tensors.h"

namespace etude::learn {
namespace {

using torch::indexing::Slice;

// weighted sums by name
class Sums {
 public:
  // adds the values where `valid` (broadcast to their shape)
  void Add(const std::string& name, const torch::Tensor& values, const torch::Tensor& valid) {
    const auto mask = valid.expand(values.sizes());
    auto& [sum, count] = sums_[name];
    sum += torch::where(mask, values.to(torch::kFloat64), torch::zeros({}, torch::kFloat64)).sum().item<double>();
    count += mask.sum().item<double>();
  }
  bool Has(const std::string& name) const { return sums_.contains(name) && sums_.at(name).second > 0; }
  double Mean(const std::string& name) const { return sums_.at(name).first / sums_.at(name).second; }
  const std::map<std::string, std::pair<double, double>>& all() const { return sums_; }

 private:
  std::map<std::string, std::pair<double, double>> sums_;
};

torch::Tensor Distance(const torch::Tensor& a, const torch::Tensor& b, int columns) {
  return (a.index({"...", Slice(0, columns)}) - b.index({"...", Slice(0, columns)})).norm(2, -1);
}

// angle between two rotations given as sin/cos of three Euler angles, degrees
torch::Tensor AngleDegrees(const torch::Tensor& a, const torch::Tensor& b) {
  const auto matrix = [](const torch::Tensor& v) {
    const auto angle = torch::atan2(v.index({"...", Slice(0, 6, 2)}), v.index({"...", Slice(1, 6, 2)}));
    const auto s = angle.sin(), c = angle.cos();
    const auto at = [](const torch::Tensor& t, int i) { return t.index({"...", i}); };
    const auto sr = at(s, 0), sp = at(s, 1), sy = at(s, 2), cr = at(c, 0), cp = at(c, 1), cy = at(c, 2);
    // Rx(roll) Ry(pitch) Rz(yaw)
    return torch::stack({cp * cy, -cp * sy, sp, cr * sy + sr * sp * cy, cr * cy - sr * sp * sy, -sr * cp,
                         sr * sy - cr * sp * cy, sr * cy + cr * sp * sy, cr * cp},
                        -1);
  };
  const auto trace = (matrix(a) * matrix(b)).sum(-1);
  return torch::rad2deg(torch::acos(((trace - 1) / 2).clamp(-1, 1)));
}

void AddTrajectory(const std::string& name, const torch::Tensor& said, const torch::Tensor& label,
                   const torch::Tensor& valid, Sums& sums) {
  const auto ours = said.index({Slice(), Slice(0, 1)});  // of the demonstrated command
  const auto distance = Distance(ours, label, 3);
  sums.Add(name + ".m", distance, valid);
  sums.Add(name + ".first_m", distance.index({"...", 0}), valid.index({"...", 0}));
  sums.Add(name + ".deg", AngleDegrees(ours.index({"...", Slice(3, 9)}), label.index({"...", Slice(3, 9)})), valid);
  const auto same = (ours.index({"...", 9}) > 0.5) == (label.index({"...", 9}) > 0.5);
  sums.Add(name + ".gripper", same, valid);
}

void AddDecoder(const policy::ModuleConfig& module, const policy::ModuleOutput& output, const policy::Labels& labels,
                Sums& sums) {
  const std::string& target = module.decoder.target;
  if (target.empty() || !labels.contains(target)) return;
  const auto& label = labels.at(target);
  const auto& valid = labels.at(target + ".valid");
  for (const auto& [kind, said] : output.decoded) {
    if (kind == "class") {
      sums.Add(module.name + ".accuracy", said.argmax(-1) == label, valid);
    } else if (kind == "trajectory") {
      AddTrajectory(module.name, said, label, valid, sums);
    } else if (kind == "pixel") {
      sums.Add(module.name + ".px", Distance(said, label, 2), valid);
    } else {
      sums.Add(module.name + ".m", Distance(said, label, 3), valid);
      if (kind == "pose")
        sums.Add(module.name + ".deg",
                 AngleDegrees(said.index({"...", Slice(3, 9)}).expand_as(label.index({"...", Slice(3, 9)})),
                              label.index({"...", Slice(3, 9)})),
                 valid);
    }
  }
}

// is the most attended image token the one that shows the label's pixel?
void AddAttention(const policy::ModuleConfig& module, const policy::ModuleOutput& output, const policy::Inputs& inputs,
                  const policy::Labels& labels, std::pair<int, int> grid, Sums& sums) {
  const auto image = std::find_if(module.attend.begin(), module.attend.end(),
                                  [](const std::string& key) { return key.starts_with("image@"); });
  if (image == module.attend.end() || !output.attention.defined()) return;
  const std::string name = image->substr(6);
  if (!labels.contains(name)) return;
  const auto [rows, columns] = grid;
  if (output.attention.size(-1) < static_cast<std::int64_t>(rows) * columns) return;
  const auto best = output.attention.index({"...", Slice(0, rows * columns)}).argmax(-1);
  const auto in_crop = labels.at(name) - inputs.crop_origin.unsqueeze(1);
  const double patch_w = static_cast<double>(inputs.images.size(3)) / columns;
  const double patch_h = static_cast<double>(inputs.images.size(2)) / rows;
  const auto column = (in_crop.index({"...", 0}) / patch_w).floor(),
             row = (in_crop.index({"...", 1}) / patch_h).floor();
  sums.Add(module.name + ".hit", best == (row * columns + column).to(torch::kInt64), labels.at(name + ".valid"));
}

Evaluation Summarize(const policy::PolicyConfig& config, const Sums& sums) {
  Evaluation result;
  for (const auto& [name, sum_count] : sums.all()) {
    if (sum_count.second <= 0) continue;
    const double mean = sum_count.first / sum_count.second;
    if (name.ends_with(".m"))
      result.metrics[name.substr(0, name.size() - 1) + "cm"] = 100 * mean;
    else if (name.ends_with(".first_m"))
      result.metrics[name.substr(0, name.size() - 1) + "cm"] = 100 * mean;
    else
      result.metrics[name] = mean;
  }
  for (const auto& module : config.modules) {
    if (sums.Has(module.name + ".accuracy"))
      result.errors[module.name] = 1 - sums.Mean(module.name + ".accuracy");
    else if (sums.Has(module.name + ".px"))
      result.errors[module.name] = sums.Mean(module.name + ".px");
    else if (sums.Has(module.name + ".m"))
      result.errors[module.name] = sums.Mean(module.name + ".m");
    else if (sums.Has(module.name + ".hit"))
      result.errors[module.name] = 1 - sums.Mean(module.name + ".hit");
  }
  return result;
}

// the module at level 1 that says which object a sentence means, if there is one
const policy::ModuleConfig* LanguageModule(const policy::PolicyConfig& config) {
  for (const auto& module : config.modules) {
    const bool looks = std::any_of(module.reads.begin(), module.reads.end(),
                                   [](const std::string& read) { return read == "image" || read == "all"; });
    if (module.level == 1 && module.decoder.target == "target_class" && !looks) return &module;
  }
  return nullptr;
}

// fraction of `sentences` whose object the module names
double Accuracy(policy::Policy& policy, const std::string& module, const std::vector<std::string>& sentences,
                const std::vector<std::string>& objects) {
  const auto count = static_cast<std::int64_t>(sentences.size());
  policy::Inputs inputs;
  inputs.sentences = sentences;
  inputs.sentence_index = torch::arange(count).unsqueeze(0);
  // nothing at this level looks at the picture; the arm may be anywhere
  inputs.joints = torch::zeros({1, policy.joints()});
  inputs.crop_origin = torch::zeros({1, 2});
  const auto outputs = policy.Forward(inputs, 1);
  const auto said = outputs.at(module).decoded.at("class").argmax(-1).flatten().to(torch::kCPU).contiguous();
  const auto& known = policy.config().objects;
  int right = 0;
  for (std::int64_t i = 0; i < count; ++i)
    right +=
        known.at(static_cast<std::size_t>(said.data_ptr<std::int64_t>()[i])) == objects[static_cast<std::size_t>(i)];
  return right / static_cast<double>(count);
}

}  // namespace

std::map<std::string, double> EvaluateLanguage(policy::Policy& policy, const language::Grammar& grammar,
                                               const std::vector<std::string>& tasks) {
  const auto* module = LanguageModule(policy.config());
  if (!module) return {};
  const auto& objects = policy.config().objects;
  const auto known = [&](const std::string& object) {
    return std::find(objects.begin(), objects.end(), object) != objects.end();
  };
  std::vector<std::string> unseen, unseen_objects, noisy, noisy_objects;
  for (const auto& sentence : language::HeldOutSentences()) {
    if (!known(sentence.object)) continue;
    unseen.push_back(sentence.text);
    unseen_objects.push_back(sentence.object);
  }
  Rng rng(MixSeed({}, "evaluate language"));
  for (const auto& name : tasks) {
    const auto task = ParseTask(name);
    if (!task) continue;
    for (std::size_t k = 0; k < objects.size(); ++k) {
      const std::string reference = task->relation() ? objects[(k + 1) % objects.size()] : "";
      const auto command = language::CommandFor(*task, objects[k], reference);
      for (int i = 0; i < 12 && grammar.Check(command); ++i) {
        noisy.push_back(grammar.Sample(command, language::Style::kNoisy, rng));
        noisy_objects.push_back(command.target);
      }
    }
  }
  const torch::NoGradGuard no_grad;
  policy.eval();
  std::map<std::string, double> metrics;
  if (!unseen.empty()) metrics[module->name + ".unseen"] = Accuracy(policy, module->name, unseen, unseen_objects);
  if (!noisy.empty()) metrics[module->name + ".noisy"] = Accuracy(policy, module->name, noisy, noisy_objects);
  policy.train();
  return metrics;
}

Result<Evaluation> Evaluate(policy::Policy& policy, const data::BatchMaker& maker, const data::Snapshot& snapshot,
                            const std::vector<data::Sample>& samples, int level, int batch) {
  if (samples.empty()) return Fail(Code::kNotFound, "evaluate: the validation split has no frames");
  const torch::NoGradGuard no_grad;
  policy.eval();
  Sums sums;
  data::Batch arrays;
  data::FrameScratch scratch;
  double loss = 0;
  Status status;
  for (std::size_t start = 0; start < samples.size() && status; start += static_cast<std::size_t>(batch)) {
    const std::size_t end = std::min(samples.size(), start + static_cast<std::size_t>(batch));
    const std::vector<data::Sample> chunk(samples.begin() + static_cast<std::ptrdiff_t>(start),
                                          samples.begin() + static_cast<std::ptrdiff_t>(end));
    status = maker.Make(snapshot, chunk, 0, data::Augment::kNo, scratch, arrays);
    if (!status) break;
    const Part part = PartOf(arrays, 0, arrays.size);
    const auto outputs = policy.Forward(part.inputs, level);
    loss +=
        policy.Loss(part.inputs, outputs, part.labels, level).total.item<double>() * static_cast<double>(end - start);
    for (const auto& module : policy.config().modules) {
      const auto output = outputs.find(module.name);
      if (output == outputs.end()) continue;
      AddDecoder(module, output->second, part.labels, sums);
      AddAttention(module, output->second, part.inputs, part.labels, policy.grid(), sums);
    }
  }
  policy.train();
  if (!status) return Fail(status.error().Wrap("evaluate"));
  Evaluation result = Summarize(policy.config(), sums);
  result.frames = static_cast<int>(samples.size());
  result.metrics["loss"] = loss / static_cast<double>(samples.size());
  return result;
}

}  // namespace etude::learn
