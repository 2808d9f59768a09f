// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/config.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "trainer/policy/names.h"
#include "trainer/policy/parts.h"

namespace etude::policy {
namespace {

using Errors = std::vector<std::string>;

constexpr std::string_view kClip = "clip:";

/// "unknown X 'word'", with the nearest of the candidates.
std::string Unknown(std::string_view what, const std::string& word, const Errors& candidates) {
  return fmt::format("unknown {} '{}'{}", what, word, Suggestion(word, candidates));
}

void CheckChoice(const std::string& key, const std::string& value, const Errors& choices, Errors& errors) {
  if (std::find(choices.begin(), choices.end(), value) == choices.end())
    errors.push_back(fmt::format("{}: '{}' is not one of {}", key, value, fmt::join(choices, ", ")));
}

void CheckRange(const std::string& key, int value, int low, int high, Errors& errors) {
  if (value < low || value > high) errors.push_back(fmt::format("{}: {} is not in [{}, {}]", key, value, low, high));
}

void CheckImage(const ImageConfig& image, Errors& errors) {
  const auto inside = [](int x, int low) { return x >= low && x <= 4096; };
  const auto& crop = image.crop;
  if (!crop.empty() &&
      (crop.size() != 4 || !inside(crop[0], 0) || !inside(crop[1], 0) || !inside(crop[2], 8) || !inside(crop[3], 8)))
    errors.push_back("image.crop: needs u0, v0 in [0, 4096] and width, height in [8, 4096] px, or nothing (derived)");
  const auto& box = image.work_volume;
  if (box.size() != 6 || !(box[0] < box[1] && box[2] < box[3] && box[4] < box[5]))
    errors.push_back("image.work_volume: needs x, y and z each from and to, m");
  if (!(image.pixel_scale > 0)) errors.push_back("image.pixel_scale: must be > 0");
  CheckChoice("image.position", image.position, {"fourier", "index"}, errors);
  if (image.layers.empty()) errors.push_back("image.layers: needs at least one layer");
  int channels = 3;
  for (std::size_t i = 0; i < image.layers.size(); ++i) {
    const ImageLayer& layer = image.layers[i];
    const std::string at = fmt::format("image.layers[{}]", i);
    CheckChoice(at + ".kind", layer.kind, {"conv", "residual"}, errors);
    CheckChoice(at + ".norm", layer.norm, {"batch", "instance", "none"}, errors);
    CheckChoice(at + ".padding", layer.padding, {"zeros", "reflect"}, errors);
    CheckRange(at + ".channels", layer.channels, 1, 4096, errors);
    CheckRange(at + ".kernel", layer.kernel, 1, 15, errors);
    CheckRange(at + ".stride", layer.stride, 1, 8, errors);
    if (layer.kernel % 2 == 0) errors.push_back(at + ".kernel: must be odd");
    if (layer.kind == "residual" && (layer.stride != 1 || layer.channels != channels))
      errors.push_back(at + ": a residual layer keeps size and channels");
    channels = layer.channels;
  }
}

// What the layers make of the picture. Only once every number is in its range.
void CheckPicture(const ImageConfig& image, Errors& errors) {
  constexpr std::int64_t kMaxStride = 4096, kMaxNumbers = std::int64_t{1} << 28;
  std::int64_t stride = 1, columns = image.crop.empty() ? 0 : image.crop[2],
               rows = image.crop.empty() ? 0 : image.crop[3];
  for (std::size_t i = 0; i < image.layers.size(); ++i) {
    const ImageLayer& layer = image.layers[i];
    if (layer.kind == "conv") {
      stride *= layer.stride;
      columns = (columns + layer.stride - 1) / layer.stride;
      rows = (rows + layer.stride - 1) / layer.stride;
    }
    if (stride > kMaxStride) {
      errors.push_back(fmt::format("image.layers: their strides make more than {} px", kMaxStride));
      return;
    }
    if (rows * columns * layer.channels > kMaxNumbers)
      errors.push_back(fmt::format("image.layers[{}]: {}x{} px of {} channels are more than {} numbers", i, columns,
                                   rows, layer.channels, kMaxNumbers));
  }
}

// More of something than any policy needs. What is checked afterwards walks over it several times.
void CheckCounts(const PolicyConfig& config, Errors& errors) {
  const auto limit = [&](const std::string& key, std::size_t count, std::size_t most) {
    if (count > most) errors.push_back(fmt::format("{}: {} of them, more than {}", key, count, most));
  };
  limit("modules", config.modules.size(), 256);
  limit("image.layers", config.image.layers.size(), 64);
  limit("objects", config.objects.size(), 4096);
  limit("tasks", config.tasks.size(), 4096);
  limit("joint_hidden", config.joint_hidden.size(), 64);
  if (!errors.empty()) return;
  for (const ModuleConfig& module : config.modules) {
    limit(fmt::format("modules.{:.64}.reads", module.name), module.reads.size(), 512);
    limit(fmt::format("modules.{:.64}.attend", module.name), module.attend.size(), 512);
    limit(fmt::format("modules.{:.64}.decoder.hidden", module.name), module.decoder.hidden.size(), 64);
    limit(fmt::format("modules.{:.64}.decoder.inputs", module.name), module.decoder.inputs.size(), 64);
  }
}

void CheckLanguage(const LanguageConfig& language, Errors& errors) {
  const bool clip = !language.clip_folder().empty();
  if (language.encoder != "default" && language.encoder != "conv" && !clip)
    errors.push_back(fmt::format("language.encoder: '{}' is neither default nor conv nor clip:DIR", language.encoder));
  CheckRange("language.buckets", language.buckets, 16, 1 << 24, errors);
  CheckRange("language.width", language.width, 1, 4096, errors);
  CheckRange("language.hidden", language.hidden, 1, 65536, errors);
  if (clip && language.senses)
    errors.push_back("language.senses: clip's text tower knows words by its own tokens; leave it out");
  if (language.sha256.empty()) return;
  const bool is_hash =
      language.sha256.size() == 64 && language.sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
  if ((!clip && !language.senses) || !is_hash)
    errors.push_back(
        fmt::format("language.sha256: '{:.100}' must be 64 hexadecimal digits, of clip:DIR or of the WordNet "
                    "of language.senses, or nothing",
                    language.sha256));
}

void CheckSizes(const PolicyConfig& config, Errors& errors) {
  CheckRange("width", config.width, 1, 4096, errors);
  CheckRange("heads", config.heads, 1, 64, errors);
  if (config.heads > 0 && config.width % config.heads != 0)
    errors.push_back(fmt::format("heads: {} does not divide width {}", config.heads, config.width));
  for (const int hidden : config.joint_hidden) CheckRange("joint_hidden", hidden, 1, 65536, errors);
  CheckChoice("attention", config.attention, {"module", "shared"}, errors);
  CheckChoice("activation", config.activation, {"silu", "selu", "relu"}, errors);
  CheckChoice("precision", config.precision, {"bf16", "float32"}, errors);
  CheckLanguage(config.language, errors);
  config.losses.Check(errors);
  const std::set<std::string> distinct(config.objects.begin(), config.objects.end());
  if (distinct.size() != config.objects.size()) errors.push_back("objects: a name stands twice");
  const std::set<std::string> tasks(config.tasks.begin(), config.tasks.end());
  if (tasks.size() != config.tasks.size()) errors.push_back("tasks: a name stands twice");
}

/// Checks the modules one by one, in the order of evaluation, against those that stand before them.
class GraphChecker {
 public:
  GraphChecker(const PolicyConfig& config, Errors& errors) : config_(config), errors_(errors) {}

  void Run() {
    if (config_.modules.empty()) errors_.push_back("modules: needs at least one module");
    for (const ModuleConfig* module : EvaluationOrder(config_)) {
      CheckModule(*module);
      earlier_.push_back(module);
    }
  }

 private:
  const ModuleConfig* Earlier(const std::string& name) const {
    for (const ModuleConfig* module : earlier_)
      if (module->name == name) return module;
    return nullptr;
  }

  Errors EarlierNames() const {
    Errors names;
    for (const ModuleConfig* module : earlier_) names.push_back(module->name);
    return names;
  }

  void Report(const ModuleConfig& module, const std::string& problem) {
    errors_.push_back(fmt::format("modules.{}.{}", module.name, problem));
  }

  /// Reports a name that is not an earlier module; says so when it is a later one.
  bool CheckEarlier(const ModuleConfig& module, const std::string& key, const std::string& name) {
    if (Earlier(name) != nullptr) return true;
    const bool exists = std::any_of(config_.modules.begin(), config_.modules.end(),
                                    [&](const ModuleConfig& other) { return other.name == name; });
    Report(module, key + ": " +
                       (exists ? fmt::format("'{}' is not evaluated before it (level)", name)
                               : Unknown("module", name, EarlierNames())));
    return false;
  }

  void CheckModule(const ModuleConfig& module) {
    const bool word = !module.name.empty() && std::all_of(module.name.begin(), module.name.end(), [](unsigned char c) {
      return std::isalnum(c) != 0 || c == '_';
    });
    if (!word || IsReservedName(module.name))
      errors_.push_back(fmt::format("modules: '{}' is not a module's name", module.name));
    if (Earlier(module.name) != nullptr) Report(module, "name: stands twice");
    CheckRange(fmt::format("modules.{}.level", module.name), module.level, 1, 64, errors_);
    if (!module.query.empty()) CheckEarlier(module, "query", module.query);
    const Errors reads = CheckReads(module);
    for (const std::string& item : module.attend) CheckAttend(module, item, reads);
    if (std::set<std::string>(module.attend.begin(), module.attend.end()).size() != module.attend.size())
      Report(module, "attend: a key stands twice");
    if (!(module.attend_weight >= 0)) Report(module, "attend_weight: must be >= 0");
    CheckDecoder(module);
  }

  Errors CheckReads(const ModuleConfig& module) {
    if (module.reads.empty()) Report(module, "reads: needs at least one key");
    const Errors reads = ResolveReads(config_, module);
    if (std::set<std::string>(reads.begin(), reads.end()).size() != reads.size())
      Report(module, "reads: a key stands twice");
    for (const std::string& key : reads)
      if (!IsReservedName(key)) CheckEarlier(module, "reads", key);
    if (module.own_image && std::find(reads.begin(), reads.end(), "image") == reads.end())
      Report(module, "own_image: the module does not read the image");
    if (module.own_image && config_.attention != "module")
      Report(module, "own_image: needs attention: module, where keys are no other's");
    return reads;
  }

  void CheckAttend(const ModuleConfig& module, const std::string& item, const Errors& reads) {
    const auto at = item.find('@');
    const std::string key = item.substr(0, at);
    if (std::find(reads.begin(), reads.end(), key) == reads.end())
      Report(module, "attend: " + Unknown("key", key, reads) + " (it must be among reads)");
    if ((key == "image") != (at != std::string::npos))
      Report(module, fmt::format("attend: '{}' must be KEY, or image@ENTITY", item));
    if (at == std::string::npos) return;
    const auto entity = data::ParseEntity(item.substr(at + 1));
    if (!entity) Report(module, "attend: " + Unknown("entity", item.substr(at + 1), data::EntityNames()));
    if (entity && !FindQuantity("pixel")->IsOf(*entity)) Report(module, fmt::format("attend: '{}' has no place", item));
  }

  void CheckDecoder(const ModuleConfig& module) {
    const DecoderConfig& decoder = module.decoder;
    if (decoder.quantity.empty() && decoder.entity.empty()) return;
    const Quantity* quantity = QuantityOf(module);
    const auto entity = data::ParseEntity(decoder.entity);
    if (!entity) Report(module, "decoder.entity: " + Unknown("entity", decoder.entity, data::EntityNames()));
    if (!quantity) Report(module, "decoder.quantity: " + Unknown("quantity", decoder.quantity, QuantityNames()));
    if (!entity || !quantity) return;
    if (entity->is_set() || !quantity->IsOf(*entity))
      Report(module, fmt::format("decoder: a {} is not of '{}'", quantity->name(), decoder.entity));
    if (decoder.quantity == "class" && config_.objects.empty()) Report(module, "decoder: a class needs objects");
    CheckReadout(module, *quantity);
    CheckChoice(fmt::format("modules.{}.decoder.rotation", module.name), decoder.rotation, {"6d", "euler_sincos"},
                errors_);
    if (decoder.inputs.empty()) Report(module, "decoder.inputs: needs at least one");
    const std::set<std::string> distinct(decoder.inputs.begin(), decoder.inputs.end());
    if (distinct.size() != decoder.inputs.size()) Report(module, "decoder.inputs: one stands twice");
    if (!(decoder.weight >= 0)) Report(module, "decoder.weight: must be >= 0");
    for (const int hidden : decoder.hidden)
      CheckRange(fmt::format("modules.{}.decoder.hidden", module.name), hidden, 1, 65536, errors_);
    for (const std::string& input : decoder.inputs) CheckInput(module, input);
  }

  void CheckReadout(const ModuleConfig& module, const Quantity& quantity) {
    const DecoderConfig& decoder = module.decoder;
    Errors readouts = quantity.own_readouts();
    readouts.insert(readouts.begin(), {"linear", "mlp"});
    CheckChoice(fmt::format("modules.{}.decoder.readout", module.name), decoder.readout, readouts, errors_);
    if (decoder.readout == "linear" && !decoder.hidden.empty())
      Report(module, "decoder.hidden: linear has no hidden layer (readout: mlp has)");
    if (decoder.readout == "mlp" && decoder.hidden.empty())
      Report(module, "decoder.hidden: mlp needs one (readout: linear has none)");
    const Errors reads = ResolveReads(config_, module);
    if (decoder.readout == "soft_argmax" && std::find(reads.begin(), reads.end(), "image") == reads.end())
      Report(module, "decoder.readout: soft_argmax needs a module that reads the image");
    const bool ray = decoder.readout == "ray";
    const bool correction = decoder.readout == "correction";
    const bool one = ray || correction || decoder.readout == "relative";
    const std::size_t wanted = decoder.readout == "difference" ? 2 : one ? 1 : 0;
    const std::string kind = ray ? "pixel" : correction ? "trajectory" : "position";
    if (decoder.from.size() != wanted)
      Report(module,
             fmt::format("decoder.from: {} needs {} modules, not {}", decoder.readout, wanted, decoder.from.size()));
    for (const std::string& name : decoder.from)
      if (CheckEarlier(module, "decoder.from", name) && !Decodes(*Earlier(name), kind))
        Report(module, fmt::format("decoder.from: '{}' decodes no {}", name, kind));
      else if (correction && Earlier(name) && Earlier(name)->decoder.rotation != decoder.rotation)
        Report(module, fmt::format("decoder.rotation: {} of what '{}' says in {}", decoder.rotation, name,
                                   Earlier(name)->decoder.rotation));
  }

  void CheckInput(const ModuleConfig& module, const std::string& text) {
    const DecoderInput input = ParseDecoderInput(text);
    static const Errors kOwn{"register", "soft_argmax", "joints", "joint_token", "language"};
    static const Errors kKinds{"register", "soft_argmax", "joints",   "joint_token",  "language",  "class",
                               "task",     "pixel",       "position", "displacement", "trajectory"};
    if (std::find(kKinds.begin(), kKinds.end(), input.kind) == kKinds.end()) {
      Report(module, "decoder.inputs: " + Unknown("input", input.kind, kKinds));
      return;
    }
    const bool decoded = std::find(kOwn.begin(), kOwn.end(), input.kind) == kOwn.end();
    const bool global = input.kind == "joints" || input.kind == "joint_token" || input.kind == "language";
    if (input.fourier && input.kind != "position" && input.kind != "displacement" && input.kind != "joints")
      Report(module,
             fmt::format("decoder.inputs: '{}': Fourier features are of a position, displacement or joints", text));
    if (decoded && input.module.empty())
      Report(module, fmt::format("decoder.inputs: '{}' must name a module, {}:MODULE", text, input.kind));
    if (global && !input.module.empty()) Report(module, fmt::format("decoder.inputs: '{}' belongs to no module", text));
    const ModuleConfig* source = &module;
    if (!input.module.empty() && !global) {
      if (!CheckEarlier(module, "decoder.inputs", input.module)) return;
      source = Earlier(input.module);
    }
    if (decoded && !Decodes(*source, input.kind))
      Report(module, fmt::format("decoder.inputs: '{}': that module decodes no {}", text, input.kind));
    const Errors reads = ResolveReads(config_, *source);
    if (input.kind == "soft_argmax" && std::find(reads.begin(), reads.end(), "image") == reads.end())
      Report(module, fmt::format("decoder.inputs: '{}': that module does not read the image", text));
  }

  const PolicyConfig& config_;
  Errors& errors_;
  std::vector<const ModuleConfig*> earlier_;
};

}  // namespace

std::string LanguageConfig::clip_folder() const {
  return encoder.starts_with(kClip) ? encoder.substr(kClip.size()) : "";
}

Status PolicyConfig::Validate() const {
  Errors errors;
  CheckCounts(*this, errors);
  if (!errors.empty()) return Fail(internal::ConfigError("policy " + name, errors));
  CheckImage(image, errors);
  if (errors.empty()) CheckPicture(image, errors);
  CheckSizes(*this, errors);
  GraphChecker(*this, errors).Run();
  if (const auto known = CheckParts(*this, "robot_specific", robot_specific); !known)
    errors.push_back(known.error().message);
  if (errors.empty()) return {};
  return Fail(internal::ConfigError("policy " + name, errors));
}

}  // namespace etude::policy
