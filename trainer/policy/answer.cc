// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/answer.h"

#include "trainer/policy/names.h"
#include "trainer/policy/quantities/common.h"
#include "trainer/policy/quantities/rotation.h"

namespace etude::policy {

OrderedJson DescribeModules(const PolicyConfig& config, const Outputs& outputs) {
  OrderedJson json = OrderedJson::object();
  for (const ModuleConfig& module : config.modules) {
    const auto output = outputs.find(module.name);
    if (output == outputs.end()) continue;
    OrderedJson& words = json[module.name] = OrderedJson::object();
    const Quantity* quantity = QuantityOf(module);
    if (quantity != nullptr && quantity->name() != "trajectory") {
      words["entity"] = module.decoder.entity;
      words["quantity"] = quantity->name();
      words["unit"] = quantity->unit();
      quantity->Say(HeadOf(config, module), output->second, words);
    }
    if (output->second.soft_argmax.defined()) words["soft_argmax"] = Rounded(output->second.soft_argmax);
  }
  return json;
}

torch::Tensor WaypointTensor(const PolicyConfig& config, const Outputs& outputs) {
  const ModuleConfig* module = DrivingModule(config);
  const auto output = module ? outputs.find(module->name) : outputs.end();
  if (output == outputs.end()) return {};
  const torch::Tensor said = output->second.decoded.at("trajectory");
  const torch::Tensor rotation = To6D(said.narrow(-1, 3, 6), module->decoder.rotation);
  return WithRotation(said, 3, rotation).select(0, 0).select(0, 0).to(torch::kFloat32);
}

std::vector<float> WaypointsOf(const PolicyConfig& config, const Outputs& outputs) {
  const torch::Tensor waypoints = WaypointTensor(config, outputs);
  if (!waypoints.defined()) return {};
  const torch::Tensor dense = waypoints.to(torch::kCPU).contiguous().view({-1});
  return {dense.data_ptr<float>(), dense.data_ptr<float>() + dense.numel()};
}

}  // namespace etude::policy
