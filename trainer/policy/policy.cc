// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/policy.h"

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <mutex>
#include <set>

#include "services/core/check.h"
#include "services/episode/action.h"
#include "trainer/policy/device.h"
#include "trainer/policy/graph.h"
#include "trainer/policy/language_encoder.h"
#include "trainer/policy/loss.h"
#include "trainer/policy/parts.h"
#include "trainer/policy/torch_error.h"

namespace etude::policy {
namespace {

using torch::Tensor;

// (P) bool: which of `pixels` (P, 2) lie in one of `rectangles` (R, 4): u0, v0, width, height.
Tensor LieIn(const Tensor& rectangles, const Tensor& pixels) {
  const Tensor all = rectangles.to(pixels.options()), corner = all.narrow(1, 0, 2), points = pixels.unsqueeze(1);
  return ((points >= corner) & (points < corner + all.narrow(1, 2, 2))).all(-1).any(-1);
}

/// Seeds torch's generator, of which a process has one, for a scope and gives it back as it was.
class SeededScope {
 public:
  explicit SeededScope(std::uint64_t seed)
      : lock_(Mutex()), generator_(at::detail::getDefaultCPUGenerator()), state_(generator_.get_state()) {
    torch::manual_seed(seed);
  }
  ~SeededScope() { generator_.set_state(state_); }

 private:
  static std::mutex& Mutex() {
    static std::mutex mutex;
    return mutex;
  }
  const std::lock_guard<std::mutex> lock_;
  at::Generator generator_;
  Tensor state_;
};

Status CheckNormalization(const Normalization& n) {
  std::vector<std::string> errors;
  const auto check = [&](const char* name, const Tensor& tensor, std::int64_t size) {
    if (!tensor.defined() || tensor.dim() != 1 || (size >= 0 && tensor.size(0) != size) || tensor.size(0) == 0)
      errors.push_back(fmt::format("{} must be a vector{}", name, size > 0 ? fmt::format(" of {}", size) : ""));
  };
  check("joint_mean", n.joint_mean, -1);
  check("joint_std", n.joint_std, n.joint_mean.defined() && n.joint_mean.dim() == 1 ? n.joint_mean.size(0) : -1);
  check("position_mean", n.position_mean, 3);
  check("position_std", n.position_std, 3);
  check("displacement_std", n.displacement_std, 3);
  if (!n.offset_std.defined() || n.offset_std.sizes() != torch::IntArrayRef{kWaypoints, 3})
    errors.push_back(fmt::format("offset_std must be ({}, 3)", kWaypoints));
  if (errors.empty()) return {};
  return Fail(Code::kInvalidArgument, fmt::format("normalization: {}", fmt::join(errors, "; ")));
}

// Opens clip's folder unless it is open, and empties `text_encoder` where the policy has none.
Status CheckTextEncoder(const PolicyConfig& config, std::shared_ptr<clip::TextEncoder>& text_encoder) {
  const LanguageConfig& language = config.language;
  if (language.clip_folder().empty()) {
    text_encoder = nullptr;
    return {};
  }
  if (language.sha256.empty())
    return Fail(Code::kInvalidArgument, fmt::format("build policy '{}': language.sha256 is not resolved; it needs what "
                                                    "'{}' holds",
                                                    config.name, language.clip_folder()));
  if (!text_encoder) {
    ETUDE_ASSIGN_OR_RETURN(text_encoder, clip::TextEncoder::Open(language.clip_folder(), language.sha256));
  }
  if (text_encoder->sha256() == language.sha256) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("build policy '{}': its language is clip's folder of content {:.12}, not {:.12}", config.name,
                          language.sha256, text_encoder->sha256()));
}

// What words mean, of a policy with senses; else nullptr.
Result<std::shared_ptr<const language::Senses>> SensesOf(const PolicyConfig& config) {
  if (config.language.senses && config.language.sha256.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("build policy '{}': language.sha256 is not resolved; it needs WordNet's", config.name));
  auto senses = OpenSenses(config.language);
  if (!senses) return Fail(senses.error().Wrap(fmt::format("build policy '{}'", config.name)));
  return senses;
}

/// Whether each module, by name, depends on the sentence through what it reads.
bool DependsOnSentence(const ModuleConfig& module, const Wiring& wiring, const std::set<std::string>& dependent) {
  for (const std::string& key : wiring.reads)
    if (key == "language" || dependent.contains(key)) return true;
  if (dependent.contains(module.query)) return true;
  for (const std::string& name : module.decoder.from)
    if (dependent.contains(name)) return true;
  return std::any_of(module.decoder.inputs.begin(), module.decoder.inputs.end(), [&](const std::string& text) {
    const DecoderInput input = ParseDecoderInput(text);
    return input.kind == "language" || dependent.contains(input.module);
  });
}

/// Names of the modules whose outputs `module` uses, encoders' among them.
std::set<std::string> UsedBy(const PolicyConfig& config, const ModuleConfig& module) {
  const auto reads = ResolveReads(config, module);
  std::set<std::string> used(reads.begin(), reads.end());
  for (const std::string& input : module.decoder.inputs) used.insert(ParseDecoderInput(input).module);
  used.insert(module.query);
  used.insert(module.decoder.from.begin(), module.decoder.from.end());
  return used;
}

/// Names of trajectories that nothing uses but such trajectories: only the demonstrated command has any.
std::set<std::string> TrajectoriesAlone(const PolicyConfig& config) {
  std::set<std::string> alone, used;
  auto order = EvaluationOrder(config);
  std::reverse(order.begin(), order.end());
  for (const ModuleConfig* module : order) {
    if (module->decoder.quantity == "trajectory" && !used.contains(module->name))
      alone.insert(module->name);
    else
      used.merge(UsedBy(config, *module));
  }
  return alone;
}

}  // namespace

struct Policy::Impl {
  PolicyConfig config;
  Normalization normalization;
  std::shared_ptr<ImageEncoder> image;
  std::shared_ptr<clip::TextEncoder> text_encoder;  ///< clip:DIR only
  std::shared_ptr<const language::Senses> senses;   ///< language.senses only
  std::shared_ptr<LanguageEncoder> language;
  std::shared_ptr<Mlp> joints;
  std::shared_ptr<LayerNorm> joints_norm;                   ///< own attention only
  std::map<std::string, std::shared_ptr<TokenHead>> heads;  ///< shared attention only: image_key, ...
  SharedAttention shared;
  std::vector<std::shared_ptr<GraphModule>> modules;  ///< in the order of evaluation
  std::set<std::string> frozen;                       ///< parts

  bool is_shared() const { return config.attention == "shared"; }
  std::shared_ptr<LanguageEncoder> MakeLanguageEncoder() const;
  Token ToKeyAndValue(const std::string& name, const Tensor& token);  ///< shared attention only
  Tokens Encode(const Inputs& inputs, int level);
};

Policy::Policy(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {
  RegisterNormalization();
  RegisterEncoders();
  RegisterModules();
  if (impl_->is_shared()) RegisterSegments();
}

void Policy::RegisterNormalization() {
  Normalization& n = impl_->normalization;
  for (const auto& [name, tensor] : {std::pair{"joint_mean", &n.joint_mean},
                                     {"joint_std", &n.joint_std},
                                     {"position_mean", &n.position_mean},
                                     {"position_std", &n.position_std},
                                     {"displacement_std", &n.displacement_std},
                                     {"offset_std", &n.offset_std}})
    *tensor = register_buffer(fmt::format("normalization_{}", name), tensor->detach().clone().to(torch::kFloat32));
}

void Policy::RegisterEncoders() {
  Impl& p = *impl_;
  const PolicyConfig& config = p.config;
  p.image = register_module("image", std::make_shared<ImageEncoder>(config.image, config.width, config.precision));
  p.language = register_module("language", p.MakeLanguageEncoder());
  const int joint_numbers = (config.joint_fourier ? 3 : 1) * static_cast<int>(p.normalization.joint_mean.size(0));
  p.joints = register_module("joints",
                             std::make_shared<Mlp>(joint_numbers, config.joint_hidden, config.width, config.activation,
                                                   p.is_shared() ? Mlp::Output::kActivated : Mlp::Output::kLinear));
  if (!p.is_shared()) {
    p.joints_norm = register_module("joints_norm", std::make_shared<LayerNorm>(config.width));
    return;
  }
  for (const char* name : {"image_key", "image_value", "joints_key", "joints_value", "language_key", "language_value"})
    p.heads[name] =
        register_module(std::string(name) + "_head", std::make_shared<TokenHead>(config.width, config.width, "relu"));
}

// In the order of evaluation.
void Policy::RegisterModules() {
  Impl& p = *impl_;
  const PolicyConfig& config = p.config;
  const auto graph = register_module("modules", std::make_shared<torch::nn::Module>());
  const std::set<std::string> alone = TrajectoriesAlone(config);
  std::set<std::string> dependent;
  Wiring wiring;
  for (const ModuleConfig* module : EvaluationOrder(config)) {
    wiring.reads = ResolveReads(config, *module);
    // image tokens come first among the keys
    std::stable_partition(wiring.reads.begin(), wiring.reads.end(),
                          [](const std::string& key) { return key == "image"; });
    wiring.depends_on_sentence = DependsOnSentence(*module, wiring, dependent);
    wiring.first_sentence_only = alone.contains(module->name);
    if (wiring.depends_on_sentence) dependent.insert(module->name);
    p.modules.push_back(graph->register_module(
        module->name, std::make_shared<GraphModule>(config, *module, wiring, p.normalization, p.image->grid())));
    if (p.is_shared() && !p.shared.levels.contains(module->level))
      p.shared.levels[module->level] = register_module(fmt::format("attention{}", module->level),
                                                       std::make_shared<Attention>(config.width, config.heads));
    wiring.index[module->name] = static_cast<int>(wiring.earlier.size());
    wiring.earlier.push_back(module);
  }
}

// Of the encoders' tokens and of the modules that have registers of their own.
void Policy::RegisterSegments() {
  Impl& p = *impl_;
  std::vector<std::string> names{"image", "joints", "language"};
  for (const auto& module : p.modules)
    if (module->config().query.empty()) names.push_back(module->config().name);
  const Tensor drawn = torch::randn({static_cast<std::int64_t>(names.size()), p.config.width});
  const auto table = register_module("segments", std::make_shared<torch::nn::Module>());
  for (std::size_t i = 0; i < names.size(); ++i)
    p.shared.segments[names[i]] = table->register_parameter(names[i], drawn[static_cast<std::int64_t>(i)].clone());
}

Policy::~Policy() = default;

std::shared_ptr<LanguageEncoder> Policy::Impl::MakeLanguageEncoder() const {
  const auto output = is_shared() ? LanguageEncoder::Output::kLinear : LanguageEncoder::Output::kNormalised;
  if (text_encoder) return std::make_shared<ClipLanguageEncoder>(text_encoder, config.width, output);
  if (config.language.encoder == "conv")
    return std::make_shared<ConvolutionEncoder>(config.language, senses, config.width, config.activation, output);
  return std::make_shared<BagOfWordsEncoder>(config.language, senses, config.width, config.activation, output);
}

Result<std::shared_ptr<Policy>> Policy::Create(const PolicyConfig& config, const Normalization& normalization,
                                               std::uint64_t seed, std::shared_ptr<clip::TextEncoder> text_encoder) {
  ETUDE_RETURN_IF_ERROR(config.Validate());
  if (config.image.crop.empty())
    return Fail(
        Code::kInvalidArgument,
        fmt::format("build policy '{}': image.crop is not resolved; it needs a camera (ResolveCrop)", config.name));
  if (config.tasks.empty() && DecodesTask(config))
    return Fail(Code::kInvalidArgument,
                fmt::format("build policy '{}': tasks is not resolved; it needs a dataset's", config.name));
  ETUDE_RETURN_IF_ERROR(CheckNormalization(normalization));
  ETUDE_RETURN_IF_ERROR(CheckTextEncoder(config, text_encoder));
  ETUDE_ASSIGN_OR_RETURN(auto senses, SensesOf(config));
  try {
    const SeededScope scope(seed);
    auto impl = std::make_unique<Impl>();
    impl->config = config;
    impl->normalization = normalization;
    impl->text_encoder = std::move(text_encoder);
    impl->senses = std::move(senses);
    return std::shared_ptr<Policy>(new Policy(std::move(impl)));
  } catch (const c10::Error& error) {
    return Fail(TorchError(fmt::format("build policy '{}'", config.name), error));
  }
}

const PolicyConfig& Policy::config() const { return impl_->config; }

int Policy::joints() const { return static_cast<int>(impl_->normalization.joint_mean.size(0)); }

int Policy::levels() const { return impl_->modules.back()->config().level; }

torch::Device Policy::device() const { return impl_->normalization.joint_mean.device(); }

std::pair<int, int> Policy::grid() const { return {impl_->image->grid().rows, impl_->image->grid().columns}; }

std::vector<std::string> Policy::KeysOf(const std::string& module) const {
  for (const auto& node : impl_->modules)
    if (node->config().name == module) return node->wiring().reads;
  ETUDE_CHECK(false, "no module '{}'", module);
}

Token Policy::Impl::ToKeyAndValue(const std::string& name, const Tensor& token) {
  return {heads.at(name + "_key")->Forward(token) + shared.segments.at(name),
          heads.at(name + "_value")->Forward(token) + shared.segments.at(name)};
}

Tokens Policy::Impl::Encode(const Inputs& inputs, int level) {
  Tokens tokens;
  const auto batch = inputs.joints.size(0), sentences = inputs.sentence_index.size(1);
  const torch::Device device = normalization.joint_mean.device();
  tokens.crop_origin = ToDevice(inputs.crop_origin, device).to(normalization.joint_mean.scalar_type());
  if (inputs.viewpoint.defined())
    tokens.viewpoint = ToDevice(inputs.viewpoint, device).to(normalization.joint_mean.scalar_type());
  tokens.joint_values =
      ((ToDevice(inputs.joints, device) - normalization.joint_mean) / normalization.joint_std).unsqueeze(1);
  const Tensor joint_token = joints->Forward(
      config.joint_fourier ? torch::cat({tokens.joint_values, JointFeatures(tokens.joint_values, normalization)}, -1)
                           : tokens.joint_values);
  const Tensor encoded =
      inputs.token_ids.defined() ? language->ForwardIds(inputs.token_ids) : language->Forward(inputs.sentences);
  tokens.sentence =
      encoded.index_select(0, ToDevice(inputs.sentence_index, device).flatten()).view({batch, sentences, config.width});
  bool look = false, look_together = false;  // at the picture, and through the shared encoder
  for (const auto& module : modules) {
    if (module->config().level > level || !module->reads_image()) continue;
    look = true;
    look_together |= module->own_image() == nullptr;
  }
  Tensor picture;
  if (look) {
    tokens.picture = ToDevice(inputs.images, device);
    tokens.image_pixels = image->grid().Centres(tokens.crop_origin.options());
    if (inputs.unattended.defined()) tokens.image_unattended = LieIn(inputs.unattended, tokens.image_pixels);
  }
  if (look_together) picture = image->Forward(tokens.picture, tokens.crop_origin);
  if (is_shared()) {
    tokens.joint_token = joint_token;
    tokens.joints = ToKeyAndValue("joints", joint_token);
    tokens.language = ToKeyAndValue("language", tokens.sentence);
    if (look_together) tokens.image = ToKeyAndValue("image", picture);
  } else {
    tokens.joint_token = joints_norm->Forward(joint_token);
    tokens.joints = {tokens.joint_token, tokens.joint_token};
    tokens.language = {tokens.sentence, tokens.sentence};
    if (picture.defined()) picture = picture.to(normalization.joint_mean.scalar_type());  // attention would lose digits
    tokens.image = {picture, picture};
  }
  return tokens;
}

Tensor Policy::EncodeSentences(const std::vector<std::string>& sentences) {
  return impl_->language->Forward(sentences);
}

Status Policy::CheckSentence(const std::string& sentence) const { return impl_->language->Check(sentence); }

Outputs Policy::Forward(const Inputs& inputs, int level, const Intervention& intervene) {
  Impl& p = *impl_;
  if (level == 0) level = levels();
  const Tokens tokens = p.Encode(inputs, level);
  std::vector<ModuleOutput> results;
  Outputs outputs;
  for (const auto& module : p.modules) {
    if (module->config().level > level) break;
    results.push_back(module->Forward(tokens, results, p.is_shared() ? &p.shared : nullptr));
    if (intervene) intervene(module->config().name, results.back());
    outputs[module->config().name] = results.back();
  }
  return outputs;
}

LossTerms Policy::Loss(const Inputs& inputs, const Outputs& outputs, const Labels& labels, int level) {
  Impl& p = *impl_;
  if (level == 0) level = levels();
  const Tensor origin = inputs.crop_origin.to(p.normalization.joint_mean.options());
  std::vector<std::string> names;
  std::vector<Tensor> terms;
  const auto add = [&](const std::string& name, const Tensor& term, double weight) {
    if (!term.defined() || weight == 0) return;
    names.push_back(name);
    terms.push_back(weight * term);
  };
  for (const auto& module : p.modules) {
    const ModuleConfig& config = module->config();
    const auto output = outputs.find(config.name);
    if (config.level > level || output == outputs.end()) continue;
    if (!config.attend.empty() && config.attend_weight > 0) {
      const Masked masked = AttentionLoss(config, p.config.losses.attention, module->wiring().reads, output->second,
                                          labels, origin, p.image->grid());
      if (masked.loss.defined()) add(config.name + ".attention", masked.Mean(), config.attend_weight);
    }
    if (!config.decoder.quantity.empty())
      add(config.name + ".decode", DecodeLoss(p.config, config, output->second, labels, origin, p.image->grid()),
          config.decoder.weight);
  }
  LossTerms result;
  const Tensor all = terms.empty() ? torch::zeros({1}, origin.options()) : torch::stack(terms);
  result.total = all.sum();
  const Tensor values = all.detach().to(torch::kCPU, torch::kFloat64);  // one transfer for all
  for (std::size_t i = 0; i < names.size(); ++i) result.terms[names[i]] = values.data_ptr<double>()[i];
  return result;
}

std::map<std::string, Tensor> Policy::StateTensors() {
  std::map<std::string, Tensor> state;
  for (const auto& item : named_parameters()) state[item.key()] = item.value();
  for (const auto& item : named_buffers()) state[item.key()] = item.value();
  return state;
}

Status Policy::LoadStateTensors(const std::map<std::string, Tensor>& tensors) {
  const auto own = StateTensors();
  std::vector<std::string> errors;
  for (const auto& [name, tensor] : own) {
    const auto found = tensors.find(name);
    if (found == tensors.end()) {
      errors.push_back(fmt::format("'{}' is missing", name));
    } else if (!found->second.defined() || found->second.sizes() != tensor.sizes()) {
      errors.push_back(
          fmt::format("'{}' is ({}), not ({})", name,
                      found->second.defined() ? fmt::format("{}", fmt::join(found->second.sizes(), ", ")) : "",
                      fmt::join(tensor.sizes(), ", ")));
    }
  }
  for (const auto& item : tensors)
    if (!own.contains(item.first)) errors.push_back(fmt::format("'{}' is not of this policy", item.first));
  if (!errors.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("load weights of policy '{}': {}", config().name, fmt::join(errors, "; ")));
  torch::NoGradGuard no_grad;
  for (const auto& [name, tensor] : own) Tensor(tensor).copy_(tensors.at(name));
  return {};
}

std::vector<std::string> Policy::ParametersOf(const std::string& part) const {
  std::vector<std::string> names;
  for (const auto& item : named_parameters())
    if (PartOfTensor(item.key()) == part) names.push_back(item.key());
  return names;
}

void Policy::Freeze(const std::vector<std::string>& parts) {
  impl_->frozen.insert(parts.begin(), parts.end());
  for (const auto& item : named_parameters())
    if (impl_->frozen.contains(PartOfTensor(item.key()))) torch::Tensor(item.value()).set_requires_grad(false);
  train(is_training());
}

const std::set<std::string>& Policy::frozen() const { return impl_->frozen; }

// of all parts only encoders of pictures and of sentences with senses compute otherwise while they are trained
void Policy::train(bool on) {
  Module::train(on);
  if (impl_->frozen.contains("image")) impl_->image->eval();
  if (impl_->frozen.contains("language")) impl_->language->eval();
  for (const auto& module : impl_->modules)
    if (module->own_image() != nullptr && impl_->frozen.contains(module->config().name)) module->own_image()->eval();
}

}  // namespace etude::policy
