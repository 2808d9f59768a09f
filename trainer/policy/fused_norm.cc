// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/fused_norm.h"

#include <ATen/Parallel.h>

#include <cmath>
#include <vector>

#include "trainer/policy/device.h"
#include "trainer/policy/norm_kernel.h"

namespace etude::policy {
namespace {

using torch::Tensor;

/// torch's Function takes absent tensors only so.
using Optional = c10::optional<Tensor>;

struct Running {
  Tensor mean, var;
};

/// How the rows of x fall into groups that share statistics, and groups into tasks for threads.
struct Rows {
  explicit Rows(const Tensor& x, bool per_image)
      : type(x.scalar_type() == torch::kFloat32 ? NormType::kFloat32 : NormType::kBfloat16),
        bytes(x.element_size()),
        channels(x.size(1)),
        groups(per_image ? x.size(0) : 1),
        per_group(x.size(0) * x.size(2) * x.size(3) / groups),
        // small enough that float32 sums keep their digits and that two passes hit the cache
        per_task(std::max<std::int64_t>(16, 32768 / channels)),
        tasks((per_group + per_task - 1) / per_task) {}

  /// Calls f(group, task, rows, byte offset) for all tasks, in parallel.
  template <class F>
  void ForEach(const F& f) const {
    at::parallel_for(0, groups * tasks, 1, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t i = begin; i < end; ++i) {
        const std::int64_t group = i / tasks, first = (i % tasks) * per_task;
        f(group, i, std::min(per_task, per_group - first),
          (group * per_group + first) * channels * static_cast<std::int64_t>(bytes));
      }
    });
  }

  NormType type;
  std::size_t bytes;
  std::int64_t channels, groups, per_group, per_task, tasks;
};

const void* At(const Tensor& tensor, std::int64_t offset) {
  return tensor.defined() ? static_cast<const char*>(tensor.data_ptr()) + offset : nullptr;
}
void* MutableAt(const Tensor& tensor, std::int64_t offset) {
  return tensor.defined() ? static_cast<char*>(tensor.data_ptr()) + offset : nullptr;
}

/// (groups, C) of pairs: adds up what the tasks of each group found, in double.
struct Moments {
  std::vector<double> first, second;
};
Moments AddUp(const Rows& rows, const std::vector<float>& first, const std::vector<float>& second) {
  const auto size = static_cast<std::size_t>(rows.groups * rows.channels);
  Moments sums{std::vector<double>(size), std::vector<double>(size)};
  for (std::int64_t i = 0; i < rows.groups * rows.tasks; ++i) {
    for (std::int64_t c = 0; c < rows.channels; ++c) {
      sums.first[(i / rows.tasks) * rows.channels + c] += first[i * rows.channels + c];
      sums.second[(i / rows.tasks) * rows.channels + c] += second[i * rows.channels + c];
    }
  }
  return sums;
}

/// (groups, C) mean and 1 / standard deviation of x; running statistics follow.
std::pair<Tensor, Tensor> Statistics(const FusedNorm& norm, const Rows& rows, const Tensor& x, Running& running) {
  if (!norm.training) return {running.mean.view({1, -1}), (running.var + norm.epsilon).rsqrt().view({1, -1})};
  // sums around a value near the mean (the first row) do not cancel
  const Tensor shift = torch::empty({rows.groups, rows.channels});
  const Tensor by_row = x.permute({0, 2, 3, 1}).reshape({rows.groups, rows.per_group, rows.channels});
  shift.copy_(by_row.select(1, 0));
  std::vector<float> sum(rows.groups * rows.tasks * rows.channels), squares(sum.size());
  const NormKernel& kernel = NormKernelFor(rows.type);
  rows.ForEach([&](std::int64_t group, std::int64_t i, std::int64_t count, std::int64_t offset) {
    kernel.sums({.x = At(x, offset), .rows = count, .channels = rows.channels},
                shift.data_ptr<float>() + group * rows.channels, sum.data() + i * rows.channels,
                squares.data() + i * rows.channels);
  });
  const Moments moments = AddUp(rows, sum, squares);
  Tensor mean = torch::empty({rows.groups, rows.channels}), inverse = torch::empty_like(mean);
  Tensor variance = torch::empty_like(mean);
  const auto count = static_cast<double>(rows.per_group);
  for (std::size_t i = 0; i < moments.first.size(); ++i) {
    const double around = moments.first[i] / count;
    const double var = std::max(0.0, moments.second[i] / count - around * around);
    mean.data_ptr<float>()[i] = static_cast<float>(shift.data_ptr<float>()[i] + around);
    inverse.data_ptr<float>()[i] = static_cast<float>(1 / std::sqrt(var + norm.epsilon));
    variance.data_ptr<float>()[i] = static_cast<float>(var * count / std::max(1.0, count - 1));
  }
  if (running.mean.defined()) {
    running.mean.lerp_(mean.view(-1), norm.momentum);
    running.var.lerp_(variance.view(-1), norm.momentum);
  }
  return {mean, inverse};
}

class Function : public torch::autograd::Function<Function> {
 public:
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& x, const Optional& maybe_weight,
                        const Optional& maybe_bias, const Optional& maybe_residual, const FusedNorm& norm,
                        Running running) {
    const Tensor weight = maybe_weight.value_or(Tensor()), bias = maybe_bias.value_or(Tensor());
    const Tensor residual = maybe_residual.value_or(Tensor());
    const Rows rows(x, norm.per_image && norm.training);
    const auto [mean, inverse] = Statistics(norm, rows, x, running);
    const Tensor scale = (weight.defined() ? inverse * weight : inverse).contiguous();
    Tensor offset = -mean * scale;
    if (bias.defined()) offset = offset + bias;
    const Tensor y = torch::empty_like(x);
    const NormKernel& kernel = NormKernelFor(rows.type);
    rows.ForEach([&](std::int64_t group, std::int64_t, std::int64_t count, std::int64_t at) {
      kernel.apply({.x = At(x, at), .residual = At(residual, at), .rows = count, .channels = rows.channels},
                   scale.data_ptr<float>() + group * rows.channels, offset.data_ptr<float>() + group * rows.channels,
                   MutableAt(y, at));
    });
    context->save_for_backward({x, y, mean, inverse, weight});
    context->saved_data["training"] = norm.training;
    context->saved_data["per_image"] = norm.per_image && norm.training;
    context->saved_data["residual"] = residual.defined();
    return y;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list grads) {
    const auto saved = context->get_saved_variables();
    const Tensor &x = saved[0], &y = saved[1], &mean = saved[2], &inverse = saved[3], &weight = saved[4];
    const Tensor grad = grads[0].to(x.scalar_type()).contiguous(kChannelsLast);
    const Rows rows(x, context->saved_data["per_image"].toBool());
    const auto [sum, product] = GradSums(rows, x, y, grad, mean, inverse);

    // dx = scale (g - mean(g) - xhat mean(g xhat)); the means are constants when the statistics are
    const Tensor scale = (weight.defined() ? inverse * weight : inverse).contiguous();
    const bool training = context->saved_data["training"].toBool();
    const auto count = static_cast<double>(rows.per_group);
    const Tensor of_x = training ? -scale * inverse * product / count : torch::zeros_like(scale);
    const Tensor constant = training ? -scale * sum / count - of_x * mean : torch::zeros_like(scale);
    const Tensor dx = torch::empty_like(x);
    const Tensor residual_grad = context->saved_data["residual"].toBool() ? torch::empty_like(x) : Tensor();
    const NormKernel& kernel = NormKernelFor(rows.type);
    rows.ForEach([&](std::int64_t group, std::int64_t, std::int64_t n, std::int64_t at) {
      const std::int64_t c = group * rows.channels;
      kernel.grad_apply({.x = At(x, at), .y = At(y, at), .grad = At(grad, at), .rows = n, .channels = rows.channels},
                        scale.data_ptr<float>() + c, of_x.data_ptr<float>() + c, constant.data_ptr<float>() + c,
                        MutableAt(dx, at), MutableAt(residual_grad, at));
    });
    return {dx,
            weight.defined() ? product.sum(0) : Tensor(),
            weight.defined() ? sum.sum(0) : Tensor(),
            residual_grad,
            Tensor(),
            Tensor()};
  }

 private:
  /// (groups, C) sums of g and of g xhat.
  static std::pair<Tensor, Tensor> GradSums(const Rows& rows, const Tensor& x, const Tensor& y, const Tensor& grad,
                                            const Tensor& mean, const Tensor& inverse) {
    const Tensor scale = inverse.contiguous(), offset = (-mean * inverse).contiguous();
    std::vector<float> sum(rows.groups * rows.tasks * rows.channels), product(sum.size());
    const NormKernel& kernel = NormKernelFor(rows.type);
    rows.ForEach([&](std::int64_t group, std::int64_t i, std::int64_t n, std::int64_t at) {
      const std::int64_t c = group * rows.channels;
      kernel.grad_sums({.x = At(x, at), .y = At(y, at), .grad = At(grad, at), .rows = n, .channels = rows.channels},
                       scale.data_ptr<float>() + c, offset.data_ptr<float>() + c, sum.data() + i * rows.channels,
                       product.data() + i * rows.channels);
    });
    const Moments moments = AddUp(rows, sum, product);
    const auto to_tensor = [&](const std::vector<double>& values) {
      return torch::tensor(values, torch::kFloat64).to(torch::kFloat32).view({rows.groups, rows.channels});
    };
    return {to_tensor(moments.first), to_tensor(moments.second)};
  }
};

}  // namespace

bool CanFuseNormRelu(const torch::Tensor& x) {
  return UsesOwnKernels(x.device()) && x.dim() == 4 && x.size(1) % 16 == 0 && x.numel() > 0 &&
         x.is_contiguous(kChannelsLast) && (x.scalar_type() == torch::kFloat32 || x.scalar_type() == torch::kBFloat16);
}

torch::Tensor FusedNormRelu(const FusedNorm& norm, const torch::Tensor& x, const torch::Tensor& weight,
                            const torch::Tensor& bias, torch::Tensor running_mean, torch::Tensor running_var,
                            const torch::Tensor& residual) {
  const Tensor like_x = residual.defined() ? residual.to(x.scalar_type()).contiguous(kChannelsLast) : residual;
  const auto optional = [](const Tensor& tensor) { return tensor.defined() ? Optional(tensor) : c10::nullopt; };
  return Function::apply(x, optional(weight), optional(bias), optional(like_x), norm,
                         Running{running_mean, running_var});
}

}  // namespace etude::policy
