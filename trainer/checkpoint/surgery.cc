// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/surgery.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "trainer/checkpoint/readiness.h"
#include "trainer/policy/architecture.h"
#include "trainer/policy/decoder.h"
#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"

namespace etude::checkpoint {
namespace {

using policy::ModuleConfig;
using policy::PolicyConfig;
using Names = std::vector<std::string>;
using Tensors = std::map<std::string, torch::Tensor>;

constexpr std::string_view kStatistics = "normalization_";

template <class Range>
bool Contains(const Range& range, const std::string& name) {
  return std::ranges::find(range, name) != range.end();
}

/// Reports where two JSON values of a part differ.
void Compare(const std::string& key, const OrderedJson& there, const OrderedJson& here, Names& problems) {
  if (there != here) problems.push_back(fmt::format("{} is {} there, {} here", key, there.dump(), here.dump()));
}

void CompareKeys(const OrderedJson& there, const OrderedJson& here, std::initializer_list<const char*> keys,
                 Names& problems) {
  for (const char* key : keys) Compare(key, there.at(key), here.at(key), problems);
}

constexpr std::initializer_list<const char*> kImageKeys{"layers", "position", "pixel_mean", "pixel_scale"};

// What weights of the same shape would compute otherwise: what is said of the part, and of the whole.
Names DifferencesOfMeaning(const PolicyConfig& there, const PolicyConfig& here, const std::string& part) {
  Names problems;
  const OrderedJson all_there = ToJson(there), all_here = ToJson(here);
  CompareKeys(all_there, all_here, {"width", "attention"}, problems);
  // no encoder has heads, and that of pictures no activation but its own
  if (!policy::IsEncoder(part)) CompareKeys(all_there, all_here, {"heads"}, problems);
  if (part != "image") CompareKeys(all_there, all_here, {"activation"}, problems);
  const ModuleConfig *a = policy::FindModule(there, part), *b = policy::FindModule(here, part);
  if (part == "image" || (b && b->own_image))
    CompareKeys(all_there.at("image"), all_here.at("image"), kImageKeys, problems);
  if (part == "language")
    Compare("language", policy::LanguageThatWeightsFit(all_there.at("language")),
            policy::LanguageThatWeightsFit(all_here.at("language")), problems);
  if (part == "joints") CompareKeys(all_there, all_here, {"joint_hidden", "joint_fourier"}, problems);
  if (!a || !b) return problems;
  Compare("own_image", a->own_image, b->own_image, problems);
  Compare("query", a->query, b->query, problems);
  if (here.attention == "shared") Compare("level", a->level, b->level, problems);  // other weights attend for it there
  CompareKeys(ToJson(a->decoder), ToJson(b->decoder), {"entity", "quantity", "readout", "from", "rotation", "hidden"},
              problems);
  for (const auto& [quantity, names] : {std::pair{"class", "objects"}, {"task", "tasks"}}) {
    const bool knows =
        b->decoder.quantity == quantity || std::ranges::any_of(b->decoder.inputs, [&](const auto& input) {
          return policy::ParseDecoderInput(input).kind == quantity;
        });
    if (knows) Compare(names, all_there.at(names), all_here.at(names), problems);
  }
  return problems;
}

// What a module attends to that no tensor is named after, so that names alone do not tell when it comes or goes.
Names UnnamedReads(const PolicyConfig& config, const std::string& part) {
  const ModuleConfig* module = policy::FindModule(config, part);
  if (!module) return {};
  Names reads = policy::ResolveReads(config, *module);
  if (config.attention != "shared") std::erase_if(reads, [](const std::string& key) { return key != "image"; });
  return reads;
}

// Of the modules that share attention, by its part.
struct Sharers {
  Names frozen, learning;
};
std::map<std::string, Sharers> SharersOf(const PolicyConfig& config, const Names& freeze) {
  std::map<std::string, Sharers> sharers;
  if (config.attention != "shared") return sharers;
  for (const ModuleConfig* module : policy::EvaluationOrder(config)) {
    Sharers& of = sharers[policy::AttentionPartOf(config, *module)];
    (Contains(freeze, module->name) ? of.frozen : of.learning).push_back(module->name);
  }
  return sharers;
}

// A module computes with what its level shares: where that learns, none of them stays as it is.
Names MovedByAttention(const PolicyConfig& config, const Names& freeze) {
  Names problems;
  for (const auto& [attention, modules] : SharersOf(config, freeze))
    if (!Contains(freeze, attention) && !modules.frozen.empty())
      problems.push_back(fmt::format("{0}: frozen, but {1}, which their level shares, learns: freeze {1} too{2}",
                                     fmt::join(modules.frozen, ", "), attention,
                                     modules.learning.empty() ? ""
                                                              : fmt::format(" ({} would learn with it as it is)",
                                                                            fmt::join(modules.learning, ", "))));
  return problems;
}

bool AddsItsInputs(const Tensors& tensors, const std::string& part) {
  return policy::Decoder::AddsItsInputs(tensors, fmt::format("modules.{}.decoder.", part));
}

/// Makes the tensors part by part.
class Surgeon {
 public:
  Surgeon(const Checkpoint& source, const SurgeryPlan& plan, const PolicyConfig& config, const Tensors& initial)
      : source_(source), plan_(plan), config_(config), theirs_(policy::PartsOf(source.metadata.policy)) {
    for (const auto& [name, tensor] : initial) surgery_.tensors[name] = tensor.detach().clone();
    for (const auto& text : plan.like) like_.push_back(NewAndOld(text));
  }

  Status CheckPlan() const {
    for (const auto& [what, names] :
         {std::pair{"init.copy", &plan_.copy}, {"init.fresh", &plan_.fresh}, {"init.freeze", &plan_.freeze}})
      ETUDE_RETURN_IF_ERROR(policy::CheckParts(config_, what, *names));
    for (const auto& part : plan_.copy)
      if (Contains(plan_.fresh, part))
        return Fail(Code::kInvalidArgument, fmt::format("init: '{}' stands in copy and in fresh", part));
    for (const auto& [part, other] : like_) {
      if (other.empty())
        return Fail(Code::kInvalidArgument, fmt::format("init.like: '{}' is not NEW=OLD, two parts' names", part));
      ETUDE_RETURN_IF_ERROR(policy::CheckParts(config_, "init.like", {part}));
      ETUDE_RETURN_IF_ERROR(policy::CheckParts(source_.metadata.policy, "init.like, the checkpoint", {other}));
    }
    return {};
  }

  void ChooseParts(bool same_robot) {
    for (const auto& part : policy::PartsOf(config_)) {
      const bool wanted = plan_.copy.empty() ? Contains(theirs_, part) && !Contains(plan_.fresh, part) &&
                                                   (same_robot || !Contains(config_.robot_specific, part))
                                             : Contains(plan_.copy, part);
      (wanted ? surgery_.copied : surgery_.fresh).insert(part);
    }
  }

  void CopyPart(const std::string& part) {
    Names problems;
    if (!Contains(theirs_, part)) problems.push_back("the checkpoint has no such part");
    if (problems.empty()) problems = DifferencesOfMeaning(source_.metadata.policy, config_, part);
    if (problems.empty()) CompareReads(part, problems);
    if (problems.empty()) CompareResidual(part, problems);
    for (auto& [name, tensor] : surgery_.tensors) {
      if (policy::PartOfTensor(name) != part || !problems.empty()) continue;
      const auto original = source_.tensors.find(name);
      if (original == source_.tensors.end())
        Grow(part, name, tensor, problems);
      else if (original->second.sizes() != tensor.sizes())
        problems.push_back(fmt::format("{} is ({}) there, ({}) here", name, fmt::join(original->second.sizes(), ", "),
                                       fmt::join(tensor.sizes(), ", ")));
      else
        tensor.copy_(original->second);
    }
    for (const auto& [name, tensor] : source_.tensors)
      if (problems.empty() && policy::PartOfTensor(name) == part && !surgery_.tensors.contains(name))
        problems.push_back(fmt::format("{} is there and not here", name));
    if (!problems.empty()) problems_.push_back(fmt::format("{}: {}", part, fmt::join(problems, ", ")));
  }

  // A new module's own image encoder sees at first what the source's does.
  void BeginImages() {
    Names problems;
    CompareKeys(ToJson(source_.metadata.policy).at("image"), ToJson(config_).at("image"), kImageKeys, problems);
    if (!problems.empty()) return;
    for (const ModuleConfig& module : config_.modules) {
      if (!module.own_image || !surgery_.fresh.contains(module.name)) continue;
      const std::string prefix = fmt::format("modules.{}.", module.name);
      const int taken = TakeAlike([&](const std::string& name) { return name.starts_with(prefix + "image."); },
                                  [&](const std::string& name) { return name.substr(prefix.size()); });
      surgery_.alike[module.name + ".image"] = {"image", taken};
    }
  }

  // What is alike of the inputs is said by the pairs as well: OBST3D's from OBST2D is TAR3D's from TAR2D.
  void BeginLike() {
    for (const auto& [part, other] : like_) {
      if (!surgery_.fresh.contains(part)) {
        problems_.push_back(fmt::format("{}: like {}, but it is copied", part, other));
        continue;
      }
      const int taken = TakeAlike([&](const std::string& name) { return policy::PartOfTensor(name) == part; },
                                  [&](const std::string& name) { return NameThere(name); });
      if (taken == 0) problems_.push_back(fmt::format("{}: nothing of it is as in {}", part, other));
      surgery_.alike[part] = {other, taken};
    }
  }

  // A copied part computes with those that it was trained with; what none of them knows the data at hand scale.
  void CopyStatistics() {
    std::set<std::string> known;
    for (const auto& part : surgery_.copied) known.merge(policy::StatisticsOf(config_, part));
    for (auto& [name, tensor] : surgery_.tensors) {
      if (!name.starts_with(kStatistics)) continue;
      const std::string what = name.substr(kStatistics.size());  // "position_mean"
      if (!known.contains(what.substr(0, what.find('_')))) continue;
      const auto original = source_.tensors.find(name);
      if (original != source_.tensors.end() && original->second.sizes() == tensor.sizes())
        tensor.copy_(original->second);
      else
        problems_.push_back(fmt::format("{}: the checkpoint's has another size", name));
    }
  }

  void FindUntrained() {
    auto records = source_.metadata.modules;
    for (auto& [module, record] : records) record.error.reset();  // measured is not learned
    for (const auto& module : NotBegun(config_, records))
      if (surgery_.copied.contains(module)) surgery_.untrained.insert(module);
  }

  void CheckFrozen() {
    for (const auto& module : surgery_.untrained)
      if (Contains(plan_.freeze, module))
        problems_.push_back(fmt::format("{}: frozen, and not trained yet: it would never learn", module));
    for (const auto& part : plan_.freeze)
      if (!surgery_.copied.contains(part))
        problems_.push_back(
            fmt::format("{}: frozen, but not copied: it would never learn{}", part,
                        Contains(config_.robot_specific, part) ? " (it knows one robot, this is another)" : ""));
    CheckFrozenReads();
    CheckFrozenAttention();
    FindMoved();
  }

  Result<Surgery> Done() {
    if (problems_.empty()) return std::move(surgery_);
    return Fail(Code::kInvalidArgument,
                fmt::format("begin with run {} step {}: what does not fit: {}; leave parts out with init.fresh",
                            source_.metadata.run, source_.metadata.step, fmt::join(problems_, "; ")));
  }

  Surgery& surgery() { return surgery_; }

 private:
  // Those tensors of which `is_taken` begin as the source's called `there`, if there is one of their size. How many
  // did.
  template <class IsTaken, class There>
  int TakeAlike(const IsTaken& is_taken, const There& there) {
    int taken = 0;
    for (auto& [name, tensor] : surgery_.tensors) {
      if (!is_taken(name)) continue;
      const auto original = source_.tensors.find(there(name));
      if (original == source_.tensors.end() || original->second.sizes() != tensor.sizes()) continue;
      tensor.copy_(original->second);
      ++taken;
    }
    return taken;
  }

  // "OBST2D=TAR2D"; the second is empty where there is none
  static std::pair<std::string, std::string> NewAndOld(const std::string& text) {
    const auto equals = text.find('=');
    if (equals == std::string::npos) return {text, ""};
    return {text.substr(0, equals), text.substr(equals + 1)};
  }

  // A tensor's name with every new part called as the old one that it is like, each word once: two parts may swap.
  std::string NameThere(const std::string& name) const {
    std::string there;
    for (std::size_t begin = 0; begin <= name.size();) {
      const std::size_t end = std::min(name.find_first_of(".:", begin), name.size());
      const std::string word = name.substr(begin, end - begin);
      const auto found = std::ranges::find(like_, word, &std::pair<std::string, std::string>::first);
      there += found == like_.end() ? word : found->second;
      if (end < name.size()) there += name[end];
      begin = end + 1;
    }
    return there;
  }

  void CompareReads(const std::string& part, Names& problems) {
    const Names before = UnnamedReads(source_.metadata.policy, part), now = UnnamedReads(config_, part);
    for (const auto& key : before)
      if (!Contains(now, key)) problems.push_back(fmt::format("reads.{} is there and not here", key));
    for (const auto& key : now)
      if (!Contains(before, key)) surgery_.grown[part].push_back("reads." + key);
  }

  // New inputs begin with zero columns, and change its answers all the same where its own inputs are added to them.
  void CompareResidual(const std::string& part, Names& problems) const {
    const bool there = AddsItsInputs(source_.tensors, part), here = AddsItsInputs(surgery_.tensors, part);
    if (there != here)
      problems.push_back(fmt::format("its decoder's first layer {} its inputs to its outputs, being as wide",
                                     there ? "adds there and not here" : "adds here and not there"));
    const ModuleConfig *before = policy::FindModule(source_.metadata.policy, part),
                       *now = policy::FindModule(config_, part);
    if (there && here && before && now && before->decoder.inputs != now->decoder.inputs)
      problems.push_back(
          fmt::format("decoder.inputs are [{}] there and [{}] here, and are added to what is made of them",
                      fmt::join(before->decoder.inputs, ", "), fmt::join(now->decoder.inputs, ", ")));
  }

  // What is new to it begins as nothing, or as noise, and stays so: all that is added for it would be in vain.
  void CheckFrozenReads() {
    for (const auto& part : plan_.freeze)
      if (const auto found = surgery_.grown.find(part); found != surgery_.grown.end())
        problems_.push_back(fmt::format(
            "{}: frozen, but it reads what its original did not, and would never learn to ({}): leave it out "
            "of init.freeze, or have it read what it read",
            part, fmt::join(found->second, ", ")));
  }

  void FindMoved() {
    for (const auto& part : plan_.freeze)
      if (const ModuleConfig* module = policy::FindModule(config_, part))
        for (const auto& read : policy::ReadParts(config_, *module))
          if (!Contains(plan_.freeze, read)) surgery_.moved[part].push_back(read);
  }

  void CheckFrozenAttention() {
    for (const auto& [attention, modules] : SharersOf(config_, plan_.freeze))
      if (Contains(plan_.freeze, attention) && !modules.learning.empty())
        surgery_.frozen_attention[attention] = modules.learning;
    std::ranges::move(MovedByAttention(config_, plan_.freeze), std::back_inserter(problems_));
  }

  void Grow(const std::string& part, const std::string& name, torch::Tensor& tensor, Names& problems) {
    if (!policy::IsOfOneInput(name)) {
      problems.push_back(fmt::format("{} is here and not there", name));
      return;
    }
    surgery_.grown[part].push_back(name.substr(name.find(part) + part.size() + 1));
    if (name.find(".decoder.") != std::string::npos) tensor.zero_();
  }

  const Checkpoint& source_;
  const SurgeryPlan& plan_;
  const PolicyConfig& config_;
  const Names theirs_;
  std::vector<std::pair<std::string, std::string>> like_;  // the new part, and the old one
  Surgery surgery_;
  Names problems_;
};

}  // namespace

Result<Surgery> Operate(const Checkpoint& source, const SurgeryPlan& plan, const PolicyConfig& config,
                        const Tensors& initial, const Embodiment& here) {
  const torch::NoGradGuard no_grad;
  Surgeon surgeon(source, plan, config, initial);
  ETUDE_RETURN_IF_ERROR(surgeon.CheckPlan());
  const std::string& robot = source.metadata.embodiment.robot;
  surgeon.ChooseParts(robot.empty() || here.robot.empty() || robot == here.robot);
  for (const auto& part : surgeon.surgery().copied) surgeon.CopyPart(part);
  surgeon.BeginImages();
  surgeon.BeginLike();
  surgeon.CopyStatistics();
  surgeon.FindUntrained();
  surgeon.CheckFrozen();
  surgeon.surgery().differences = Differences(here, source.metadata.embodiment);
  return surgeon.Done();
}

Status CheckSurgery(const Checkpoint& source, const SurgeryPlan& plan, const PolicyConfig& config) {
  const Tensors none;
  ETUDE_RETURN_IF_ERROR(Surgeon(source, plan, config, none).CheckPlan());
  const Names theirs = policy::PartsOf(source.metadata.policy);
  for (const auto& part : plan.copy)
    if (!Contains(theirs, part))
      return Fail(Code::kInvalidArgument, fmt::format("init.copy: '{}': the checkpoint has no such part", part));
  for (const auto& part : plan.freeze)
    if (!Contains(theirs, part) || Contains(plan.fresh, part) || (!plan.copy.empty() && !Contains(plan.copy, part)))
      return Fail(Code::kInvalidArgument,
                  fmt::format("init.freeze: '{}' begins anew: nothing was learned yet that could be kept", part));
  return CheckFreeze(config, plan.freeze);
}

Status CheckFreeze(const PolicyConfig& config, const std::vector<std::string>& freeze) {
  const Names problems = MovedByAttention(config, freeze);
  if (problems.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("init.freeze: {}", fmt::join(problems, "; ")));
}

std::set<std::string> Unsettled(const PolicyConfig& config, const Surgery& surgery) {
  std::set<std::string> moved = surgery.fresh, unsettled;
  for (const ModuleConfig* module : policy::EvaluationOrder(config)) {
    const auto reads = policy::ReadParts(config, *module);
    const bool other = surgery.grown.contains(module->name) ||
                       surgery.fresh.contains(policy::AttentionPartOf(config, *module)) ||
                       std::ranges::any_of(reads, [&](const auto& part) { return moved.contains(part); });
    if (!other) continue;
    moved.insert(module->name);
    if (surgery.copied.contains(module->name)) unsettled.insert(module->name);
  }
  return unsettled;
}

int FirstLevelToLearn(const PolicyConfig& config, const Surgery& surgery) {
  const auto order = policy::EvaluationOrder(config);
  for (const ModuleConfig* module : order) {
    if (surgery.fresh.contains(module->name) || surgery.grown.contains(module->name) ||
        surgery.untrained.contains(module->name) || surgery.fresh.contains(policy::AttentionPartOf(config, *module)))
      return module->level;
    Names used;
    for (const auto& item : module->attend) used.push_back(item.substr(0, item.find('@')));
    for (const auto& text : module->decoder.inputs) {
      const auto kind = policy::ParseDecoderInput(text).kind;
      if (kind == "language" || kind == "joint_token") used.push_back(kind == "language" ? kind : "joints");
    }
    for (const char* encoder : {"image", "language", "joints"})
      if (surgery.fresh.contains(encoder) && Contains(used, encoder)) return module->level;
  }
  return order.back()->level;
}

}  // namespace etude::checkpoint
