// SPDX-License-Identifier: Apache-2.0
// train_paper: one training step of preset `paper` against the same network written plainly in NCHW float32,
// with the same weights, inputs, losses and optimizer. Both sides are first shown to answer alike.
// train_compact: training steps of preset `compact` as the trainer takes them (a copy of the network for each core,
// bf16, the flat optimizer), a picture with its six sentences being one sample, against one float32 network on all
// cores with torch's optimizer.
#include <fmt/format.h>
#include <torch/nn/utils/clip_grad.h>
#include <torch/optim/adam.h>
#include <torch/optim/adamw.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "services/core/config.h"
#include "trainer/learn/optimizer.h"
#include "trainer/learn/replicas.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/names.h"
#include "trainer/policy/policy.h"
#include "trainer/policy/torch.h"
#include "trainer/policy/torch_process.h"

namespace etude::policy {
namespace {

using torch::Tensor;

constexpr int kJoints = 7;

double Now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// How much faster two busy threads are than one, now: 2 on two free cores.
double SpinRatio() {
  const auto spin = [] {
    volatile std::uint64_t x = 1;
    for (int i = 0; i < 60'000'000; ++i) x = x * 6364136223846793005ULL + 1;
  };
  double start = Now();
  spin();
  const double one = Now() - start;
  start = Now();
  std::thread other(spin);
  spin();
  other.join();
  return 2 * one / (Now() - start);
}

Inputs MakeInputs(const PolicyConfig& config, int batch, int sentences) {
  Inputs inputs;
  inputs.images = torch::randint(0, 256, {batch, 3, config.image.crop[3], config.image.crop[2]}, torch::kUInt8)
                      .contiguous(torch::MemoryFormat::ChannelsLast);
  inputs.crop_origin =
      torch::tensor({float(config.image.crop[0]), float(config.image.crop[1])}).expand({batch, 2}).contiguous();
  inputs.joints = torch::randn({batch, kJoints});
  // as many different sentences as the trainer's batches have at most: 18 commands in four wordings
  const int distinct = std::min(batch * sentences, 72);
  for (int i = 0; i < distinct; ++i)
    inputs.sentences.push_back(fmt::format("{} the {} {} number {}", i % 2 ? "pick up" : "push", i % 3 ? "red" : "blue",
                                           i % 5 ? "can" : "carton", i));
  inputs.sentence_index = torch::arange(batch * sentences).remainder(distinct).view({batch, sentences});
  return inputs;
}

Labels MakeLabels(const PolicyConfig& config, int batch, int sentences) {
  const Tensor corner = torch::tensor({float(config.image.crop[0]), float(config.image.crop[1])});
  const Tensor size = torch::tensor({float(config.image.crop[2]), float(config.image.crop[3])});
  Labels labels;
  labels["target.class"] = torch::randint(0, 6, {batch, sentences}).to(torch::kFloat32);
  labels["target.pixel"] = corner + size * torch::rand({batch, sentences, 2});
  labels["ee.pixel"] = corner + size * torch::rand({batch, 1, 2});
  labels["target.position"] = 0.2 * torch::randn({batch, sentences, 3});
  labels["target.pose"] = 0.2 * torch::randn({batch, sentences, 9});
  labels["ee.position"] = 0.2 * torch::randn({batch, 1, 3});
  labels["ee.pose"] = 0.2 * torch::randn({batch, 1, 9});
  labels["target.displacement"] = 0.2 * torch::randn({batch, sentences, 3});
  labels["ee.trajectory"] = torch::rand({batch, 1, 12, 10});
  return labels;
}

std::shared_ptr<Policy> MakePolicy(PolicyConfig config, const std::string& precision) {
  config.precision = precision;
  return Policy::Create(config, Normalization::Unit(kJoints), 1).value();
}

/// The paper's network as its equations read: NCHW, float32, one operation after the other, every key and value
/// projected at every level. Weights are copies of a Policy's.
class PlainPaper {
 public:
  explicit PlainPaper(Policy& policy) : policy_(policy), config_(policy.config()) {
    for (const auto& item : policy.named_parameters())
      weights_[item.key()] = item.value().detach().clone().requires_grad_(true);
    for (const auto& item : policy.named_buffers()) weights_[item.key()] = item.value().detach().clone();
  }

  std::vector<Tensor> Parameters() const {
    std::vector<Tensor> parameters;
    for (const auto& [name, weight] : weights_)
      if (weight.requires_grad()) parameters.push_back(weight);
    return parameters;
  }

  /// @param language  (B, 1, d) the sentence's token, from the policy: tokenising is not compared
  Outputs Forward(const Inputs& inputs, const Tensor& language) {
    const auto batch = inputs.images.size(0);
    const Tensor joints = Joints(inputs.joints);
    const Tensor image = ImageTokens(inputs.images);
    std::vector<Tensor> keys{Head("image_key", image) + Segment("image"),
                             Head("language_key", language) + Segment("language"),
                             Head("joints_key", joints) + Segment("joints")};
    std::vector<Tensor> values{Head("image_value", image) + Segment("image"),
                               Head("language_value", language) + Segment("language"),
                               Head("joints_value", joints) + Segment("joints")};
    Outputs outputs;
    std::vector<const ModuleConfig*> order = EvaluationOrder(config_);
    for (std::size_t i = 0; i < order.size();) {
      const int level = order[i]->level;
      std::vector<const ModuleConfig*> modules;
      std::vector<Tensor> queries;
      for (; i < order.size() && order[i]->level == level; ++i) {
        modules.push_back(order[i]);
        queries.push_back(order[i]->query.empty() ? Slot(order[i]->name, batch)
                                                  : outputs.at(order[i]->query).register_token);
      }
      const auto [registers, maps] =
          MultiHead(level, torch::cat(queries, 1), torch::cat(keys, 1), torch::cat(values, 1));
      for (std::size_t m = 0; m < modules.size(); ++m)
        outputs[modules[m]->name] = Decode(*modules[m], registers.narrow(1, m, 1), maps.narrow(2, m, 1));
      for (std::size_t m = 0; m < modules.size(); ++m) {
        keys.push_back(registers.narrow(1, m, 1));
        values.push_back(registers.narrow(1, m, 1));
      }
    }
    return outputs;
  }

 private:
  const Tensor& W(const std::string& name) const { return weights_.at(name); }
  Tensor Linear(const std::string& name, const Tensor& x) const {
    return torch::nn::functional::linear(x, W(name + ".weight"), W(name + ".bias"));
  }
  Tensor Segment(const std::string& name) const { return W("segments." + name); }
  Tensor Head(const std::string& name, const Tensor& x, const std::string& suffix = "_head") const {
    const Tensor y = Linear(name + suffix + ".linear", x);
    return torch::relu(
        torch::layer_norm(y, {y.size(-1)}, W(name + suffix + ".norm.weight"), W(name + suffix + ".norm.bias")));
  }
  Tensor Slot(const std::string& name, std::int64_t batch) const {
    const std::string prefix = "modules." + name + ".";
    const Tensor y = Linear(prefix + "query_head.linear", W(prefix + "register"));
    const Tensor normed =
        torch::layer_norm(y, {y.size(-1)}, W(prefix + "query_head.norm.weight"), W(prefix + "query_head.norm.bias"));
    return (torch::selu(normed) + Segment(name)).expand({batch, 1, config_.width});
  }
  Tensor Mlp(const std::string& name, Tensor x, std::size_t layers, bool activate_last) const {
    for (std::size_t i = 0; i < layers; ++i) {
      x = Linear(fmt::format("{}.layer{}", name, i), x);
      if (i + 1 < layers || activate_last) x = torch::selu(x);
    }
    return x;
  }
  /// The paper's decoders read their register alone.
  Tensor Decoder(const std::string& prefix, const Tensor& reg, std::size_t layers) const {
    Tensor x = torch::nn::functional::linear(reg, W(prefix + "from.register"), W(prefix + "bias"));
    for (std::size_t i = 1; i < layers; ++i) x = Linear(fmt::format("{}layer{}", prefix, i), torch::selu(x));
    return x;
  }
  Tensor Joints(const Tensor& q) const {
    const Tensor normal = (q - W("normalization_joint_mean")) / W("normalization_joint_std");
    return Mlp("joints", normal.unsqueeze(1), config_.joint_hidden.size() + 1, true);
  }

  Tensor BatchNorm(const std::string& name, const Tensor& x) {
    return torch::batch_norm(x, W(name + ".weight"), W(name + ".bias"), weights_.at(name + ".running_mean"),
                             weights_.at(name + ".running_var"), true, 0.1, 1e-5, true);
  }

  Tensor ImageTokens(const Tensor& images) {
    Tensor x = images.contiguous().to(torch::kFloat32) / 255;
    for (std::size_t i = 0; i < config_.image.layers.size(); ++i) {
      const ImageLayer& layer = config_.image.layers[i];
      const auto name = [&](int j, const char* what) { return fmt::format("image.layer{}_{}_{}", i, j, what); };
      if (layer.kind == "conv") {
        const int half = layer.kernel / 2;
        const bool reflect = layer.padding == "reflect";
        if (reflect) x = torch::reflection_pad2d(x, {half, half, half, half});
        x = torch::conv2d(x, W(name(0, "weight")), {}, layer.stride, reflect ? 0 : half);
        x = torch::relu(torch::instance_norm(x, {}, {}, {}, {}, true, 0.1, 1e-5, true));
      } else {
        Tensor y = torch::relu(BatchNorm(name(0, "norm"), torch::conv2d(x, W(name(0, "weight")), {}, 1, 1)));
        y = BatchNorm(name(1, "norm"), torch::conv2d(y, W(name(1, "weight")), {}, 1, 1));
        x = torch::relu(x + y);
      }
    }
    const auto rows = x.size(2), columns = x.size(3), batch = x.size(0);
    const Tensor tokens = torch::relu(Linear("image.narrow", x.flatten(2).transpose(1, 2)));
    const Tensor column = torch::arange(columns, torch::kFloat32).repeat({rows});
    const Tensor row = torch::arange(rows, torch::kFloat32).repeat_interleave(columns);
    const Tensor place = torch::stack({column, row}, -1).expand({batch, rows * columns, 2});
    return torch::relu(Linear("image.position", torch::cat({tokens, place}, -1)));
  }

  /// torch::nn::MultiheadAttention's arithmetic; the map of each head (B, h, Q, K).
  std::pair<Tensor, Tensor> MultiHead(int level, const Tensor& query, const Tensor& key, const Tensor& value) const {
    const std::string prefix = fmt::format("attention{}.", level);
    const auto split = [&](const Tensor& x) {
      return x.view({x.size(0), x.size(1), config_.heads, -1}).transpose(1, 2);
    };
    const Tensor q = split(Linear(prefix + "query", query));
    const Tensor k = split(torch::nn::functional::linear(key, W(prefix + "key_weight")));
    const Tensor v = split(torch::nn::functional::linear(value, W(prefix + "value_weight"), W(prefix + "value_bias")));
    const Tensor logits = torch::matmul(q, k.transpose(-2, -1)) / std::sqrt(double(q.size(-1)));
    const Tensor maps = torch::softmax(logits, -1);
    const Tensor sums = torch::matmul(maps, v).transpose(1, 2).flatten(2);
    return {Linear(prefix + "output", sums), maps};
  }

  ModuleOutput Decode(const ModuleConfig& module, const Tensor& reg, const Tensor& maps) const {
    const Tensor& mean = W("normalization_position_mean");
    const Tensor& std = W("normalization_position_std");
    ModuleOutput output;
    output.register_token = reg;
    output.attention = maps.mean(1);
    const Tensor raw = Decoder("modules." + module.name + ".decoder.", reg, module.decoder.hidden.size() + 1);
    const std::string kind = module.decoder.quantity;
    if (kind == "class") output.decoded["class"] = raw;
    if (kind == "pixel") output.decoded["pixel"] = 112 * (1 + raw);  // of 224
    if (kind == "pose")
      output.decoded["pose"] = torch::cat({mean + std * raw.narrow(-1, 0, 3), raw.narrow(-1, 3, 6)}, -1);
    if (kind == "displacement") output.decoded[kind] = W("normalization_displacement_std") * raw;
    if (kind == "trajectory") {
      const Tensor points = raw.view({raw.size(0), 1, 12, 10});
      output.gripper_logits = points.select(-1, 9);
      output.waypoint_scale = W("normalization_offset_std").mean(-1);
      output.decoded[kind] = torch::cat(
          {mean + std * points.narrow(-1, 0, 3), points.narrow(-1, 3, 6), torch::sigmoid(points.narrow(-1, 9, 1))}, -1);
    }
    return output;
  }

  Policy& policy_;
  const PolicyConfig& config_;
  std::map<std::string, Tensor> weights_;
};

template <class Forward>
void Step(torch::optim::Optimizer& optimizer, const std::vector<Tensor>& parameters, Policy& policy,
          const Inputs& inputs, const Labels& labels, const Forward& forward) {
  optimizer.zero_grad();
  policy.Loss(inputs, forward(), labels).total.backward();
  torch::nn::utils::clip_grad_norm_(parameters, 1.0);
  optimizer.step();
}

/// Largest difference of what two sides decode, relative to its spread.
double Disagreement(const Outputs& a, const Outputs& b) {
  double worst = 0;
  for (const auto& [name, output] : a)
    for (const auto& [kind, value] : output.decoded)
      worst =
          std::max(worst, ((value - b.at(name).decoded.at(kind)).abs().mean() / (value.std() + 1e-6)).item<double>());
  return worst;
}

void Report(const char* name, const std::vector<double>& ours, const std::vector<double>& baseline) {
  const auto range = [](const std::vector<double>& v) {
    return fmt::format("median {:.1f} (min {:.1f}, max {:.1f})", Median(v), *std::min_element(v.begin(), v.end()),
                       *std::max_element(v.begin(), v.end()));
  };
  fmt::print(stderr, "{}: ours {}, baseline {} samples/s\n", name, range(ours), range(baseline));
  const OrderedJson json{{"name", name},
                         {"value", Median(ours)},
                         {"unit", "samples/s"},
                         {"baseline", Median(baseline)},
                         {"ratio", Median(ours) / Median(baseline)}};
  fmt::print("{}\n", json.dump());
  std::fflush(stdout);
}

/// Interleaved rounds of `steps` steps a side.
void Measure(const char* name, int batch, int rounds, int our_steps, int baseline_steps,
             const std::function<void()>& ours, const std::function<void()>& baseline) {
  std::vector<double> our_rate, baseline_rate;
  for (int round = -1; round < rounds; ++round) {
    double start = Now();
    for (int i = 0; i < (round < 0 ? 1 : baseline_steps); ++i) baseline();
    const double base = batch * baseline_steps / (Now() - start);
    start = Now();
    for (int i = 0; i < our_steps; ++i) ours();
    const double our = batch * our_steps / (Now() - start);
    if (round < 0) continue;  // the first round warms up
    our_rate.push_back(our);
    baseline_rate.push_back(base);
  }
  Report(name, our_rate, baseline_rate);
}

void TrainPaper(const PolicyConfig& config) {
  constexpr int kBatch = 8;
  torch::manual_seed(1);
  const auto policy = MakePolicy(config, "bf16");
  PlainPaper plain(*policy);
  const Inputs inputs = MakeInputs(config, kBatch, 1);
  const Labels labels = MakeLabels(config, kBatch, 1);
  // the sentence's token of both sides is the policy's own at the start
  torch::optim::Adam ours(policy->parameters(), 1e-4);
  const auto parameters = plain.Parameters();
  torch::optim::Adam theirs(parameters, 1e-4);
  const auto language = [&] {
    torch::NoGradGuard no_grad;
    return policy->EncodeSentences(inputs.sentences).unsqueeze(1);
  };
  {
    torch::NoGradGuard no_grad;
    const Tensor token = language();
    const auto exact = MakePolicy(config, "float32");
    fmt::print(stderr, "train_paper: outputs differ by {:.5f} (float32), {:.5f} (bf16) of their spread\n",
               Disagreement(plain.Forward(inputs, token), exact->Forward(inputs)),
               Disagreement(plain.Forward(inputs, token), policy->Forward(inputs)));
  }
  const Tensor token = language();
  Measure(
      "train_paper", kBatch, 5, 3, 1,
      [&] { Step(ours, policy->parameters(), *policy, inputs, labels, [&] { return policy->Forward(inputs); }); },
      [&] { Step(theirs, parameters, *policy, inputs, labels, [&] { return plain.Forward(inputs, token); }); });
}

// The same as the arrays that the trainer's data loader makes.
data::Batch ToBatch(const Inputs& inputs, const Labels& labels) {
  data::Batch batch;
  batch.size = static_cast<int>(inputs.images.size(0));
  batch.sentences_each = static_cast<int>(inputs.sentence_index.size(1));
  batch.height = static_cast<int>(inputs.images.size(2));
  batch.width = static_cast<int>(inputs.images.size(3));
  batch.joints_each = kJoints;
  const auto copy = [](const Tensor& tensor, auto& values) {
    using Value = std::remove_reference_t<decltype(values[0])>;
    const Tensor dense = tensor.contiguous();
    values.assign(dense.data_ptr<Value>(), dense.data_ptr<Value>() + dense.numel());
  };
  copy(inputs.images.permute({0, 2, 3, 1}), batch.images);
  copy(inputs.crop_origin, batch.crop_origin);
  copy(inputs.joints, batch.joints);
  copy(inputs.sentence_index, batch.sentence_index);
  batch.sentences = inputs.sentences;
  for (const auto& [name, label] : labels) {
    data::LabelArray& array = batch.labels[name];
    array.shape = label.sizes().vec();
    copy(label, array.values);
    array.valid_shape = {array.shape.begin(), array.shape.begin() + (name == "ee.trajectory" ? 3 : 2)};
    std::size_t count = 1;
    for (const auto size : array.valid_shape) count *= static_cast<std::size_t>(size);
    array.valid.assign(count, 1);
  }
  return batch;
}

void TrainCompact(const PolicyConfig& config, int batch) {
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  torch::manual_seed(1);
  data::Batch data = ToBatch(MakeInputs(config, batch, 6), MakeLabels(config, batch, 6));

  const auto use_threads = [](int threads) {
    SetTorchThreads(threads);
    learn::SetBlasThreads(threads);
  };
  use_threads(1);
  std::vector<std::shared_ptr<Policy>> copies;
  for (int i = 0; i < cores; ++i) copies.push_back(MakePolicy(config, "bf16"));
  learn::Optimizer flat({}, copies);
  learn::Replicas replicas(copies);
  const auto ours = [&] {
    use_threads(1);
    flat.ZeroGradients();
    if (!replicas.Backward(data, 0)) std::abort();
    flat.Step(3e-3);
  };

  const auto exact = MakePolicy(config, "float32");
  torch::optim::AdamW adamw(exact->parameters(), torch::optim::AdamWOptions(3e-3));
  const auto baseline = [&] {
    use_threads(cores);
    const learn::Part part = learn::PartOf(data, 0, data.size);
    Step(adamw, exact->parameters(), *exact, part.inputs, part.labels, [&] { return exact->Forward(part.inputs); });
  };
  Measure("train_compact", batch, 7, 10, 10, ours, baseline);
}

// `only`: paper or compact; empty: both.
int Main(const std::string& only) {
  SetTorchThreads(0);
  fmt::print(stderr, "{}; two spinning threads do {:.2f} x the work of one\n", DescribeTorch(), SpinRatio());
  const std::string folder = "trainer/experiments/policies/";
  const auto paper = LoadConfig<PolicyConfig>(folder + "paper/base.yaml");
  const auto compact = LoadConfig<PolicyConfig>(folder + "compact/base.yaml",
                                                {"image.crop=[41,75,144,80]", "tasks=[pick, push, put_down]"});
  if (!paper || !compact) {
    fmt::print(stderr, "train_bench: run it from the repository's root: {}\n",
               (!paper ? paper.error() : compact.error()).message);
    return 1;
  }
  if (only != "compact") TrainPaper(*paper);
  if (only != "paper") TrainCompact(*compact, 64);
  fmt::print(stderr, "two spinning threads do {:.2f} x the work of one\n", SpinRatio());
  return 0;
}

}  // namespace
}  // namespace etude::policy

int main(int argc, char** argv) {
  etude::policy::PrepareTorchProcess(argv);
  return etude::policy::Main(argc > 1 ? argv[1] : "");
}
