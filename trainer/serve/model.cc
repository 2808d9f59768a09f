// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "services/core/hash.h"
#include "services/episode/action.h"
#include "services/episode/viewpoint.h"
#include "trainer/checkpoint/readiness.h"
#include "trainer/policy/answer.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"
#include "trainer/policy/torch_error.h"

namespace etude::serve {
namespace {

// what an observation tells of the robot and its camera, and what an answer will be
checkpoint::Embodiment Seen(const bus::Observation& observation) {
  checkpoint::Embodiment seen = checkpoint::OwnFormats();
  seen.joints = static_cast<int>(observation.joints.size());
  seen.width = static_cast<int>(observation.width);
  seen.height = static_cast<int>(observation.height);
  seen.robot = observation.robot;
  // fx, fy, cx, cy
  if (observation.intrinsics.size() == 4 && observation.intrinsics[1] > 0)
    seen.fovy = 2 * std::atan(observation.height / (2 * observation.intrinsics[1]));
  if (observation.camera_pose.size() == 7) seen.camera_pose = observation.camera_pose;
  return seen;
}

// (1, kViewpointSize)
Result<torch::Tensor> SeenFrom(const bus::Observation& observation) {
  const auto finite = [](const std::vector<double>& numbers) {
    return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
  };
  const auto &k = observation.intrinsics, &p = observation.camera_pose;
  if (k.size() != 4 || p.size() != 7)
    return Fail(Code::kInvalidArgument,
                "the observation does not say its camera (intrinsics and pose), which this policy reads");
  const Eigen::Quaterniond q(p[3], p[4], p[5], p[6]);
  if (!finite(k) || !finite(p) || !(k[0] > 0 && k[1] > 0) || !(q.norm() > 0.5 && q.norm() < 2))
    return Fail(Code::kInvalidArgument, fmt::format("no camera has intrinsics [{:.4g}] and pose [{:.4g}]",
                                                    fmt::join(k, ", "), fmt::join(p, ", ")));
  const Viewpoint viewpoint = ViewpointOf(k[0], k[1], k[2], k[3], {{p[0], p[1], p[2]}, q.normalized()});
  return torch::tensor(std::vector<float>(viewpoint.begin(), viewpoint.end())).view({1, kViewpointSize});
}

// The pictures of training have square pixels, and the camera's axis in their middle (services/policy/conversion.h):
// who does not read the camera takes every picture for such a one.
Status CheckCentred(const bus::Observation& observation) {
  constexpr double kNear = 0.01;
  const auto& k = observation.intrinsics;
  if (k.size() != 4) return {};
  const double cx = 0.5 * observation.width, cy = 0.5 * observation.height;
  const auto near = [](double a, double b) { return std::abs(a - b) <= kNear * std::abs(b); };  // false for NaN
  if (near(k[0], k[1]) && near(k[2], cx) && near(k[3], cy)) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("this policy was trained for something else (camera intrinsics: fx {:.4g}, fy {:.4g}, centre "
                          "({:.4g}, {:.4g}) here; fx = fy, centre ({:.4g}, {:.4g}) there)",
                          k[0], k[1], k[2], k[3], cx, cy));
}

}  // namespace

Result<std::shared_ptr<const Model>> Model::FromBytes(std::span<const std::uint8_t> bytes, clip::Folders* folders,
                                                      const torch::Device& device, Cameras cameras) {
  auto model = std::shared_ptr<Model>(new Model());
  ETUDE_ASSIGN_OR_RETURN(auto made, checkpoint::Decode(bytes));
  ETUDE_ASSIGN_OR_RETURN(model->policy_, checkpoint::BuildPolicy(made, folders));
  try {
    model->policy_->to(device);
  } catch (const c10::Error& error) {
    return Fail(policy::TorchError(fmt::format("put the policy on {}", device.str()), error, Code::kUnavailable));
  }
  model->metadata_ = std::move(made.metadata);
  if (cameras == Cameras::kAny) {
    model->metadata_.embodiment.fovy = 0;
    model->metadata_.embodiment.camera_pose.clear();
  }
  model->untrained_ = checkpoint::WhyUntrained(model->metadata_);
  model->sha256_ = Sha256Hex(bytes);
  return std::shared_ptr<const Model>(std::move(model));
}

Result<std::shared_ptr<const Model>> Model::FromFile(const Path& path, clip::Folders* folders,
                                                     const torch::Device& device, Cameras cameras) {
  ETUDE_ASSIGN_OR_RETURN(const auto bytes, ReadBinaryFile(path));
  auto model = FromBytes(bytes, folders, device, cameras);
  if (!model) return Fail(model.error().Wrap(fmt::format("read '{}'", path.string())));
  return model;
}

Result<policy::Inputs> Model::Prepare(const bus::Observation& observation) const {
  const std::size_t width = observation.width, height = observation.height;
  if (width > 16384 || height > 16384 || observation.image.size() != width * height * 3)
    return Fail(Code::kInvalidArgument,
                fmt::format("image of {} bytes is not {}x{} RGB", observation.image.size(), width, height));
  if (const auto differences = checkpoint::Differences(Seen(observation), metadata_.embodiment); !differences.empty())
    return Fail(Code::kInvalidArgument,
                fmt::format("this policy was trained for something else ({})", fmt::join(differences, "; ")));
  if (metadata_.embodiment.fovy > 0 && !policy::ReadsCamera(metadata_.policy))
    ETUDE_RETURN_IF_ERROR(CheckCentred(observation));
  if (static_cast<int>(observation.joints.size()) != metadata_.embodiment.joints)
    return Fail(Code::kInvalidArgument,
                fmt::format("{} joints: this policy reads {}", observation.joints.size(), metadata_.embodiment.joints));
  if (!std::all_of(observation.joints.begin(), observation.joints.end(), [](float q) { return std::isfinite(q); }))
    return Fail(Code::kInvalidArgument, "a joint position is not a finite number");
  ETUDE_RETURN_IF_ERROR(policy_->CheckSentence(observation.instruction));

  const codec::Region crop = policy::CropOf(metadata_.policy.image);
  if (!codec::Fits(crop, static_cast<int>(width), static_cast<int>(height)))
    return Fail(Code::kInvalidArgument,
                fmt::format("picture of {}x{} px: this policy looks at {}x{} px from ({}, {}) on", width, height,
                            crop.width, crop.height, crop.u, crop.v));
  policy::Inputs inputs;
  auto image = torch::empty({1, crop.height, crop.width, 3}, torch::kUInt8);
  ETUDE_RETURN_IF_ERROR(codec::CropPicture(observation.image, static_cast<int>(width), static_cast<int>(height), crop,
                                           {image.data_ptr<std::uint8_t>(), crop.bytes()}));
  inputs.images = image.permute({0, 3, 1, 2});
  inputs.crop_origin = torch::tensor({static_cast<float>(crop.u), static_cast<float>(crop.v)}).view({1, 2});
  if (policy::ReadsCamera(metadata_.policy)) {
    ETUDE_ASSIGN_OR_RETURN(inputs.viewpoint, SeenFrom(observation));
  }
  inputs.joints = torch::tensor(observation.joints, torch::kFloat32).view({1, -1});
  inputs.sentences = {observation.instruction};
  inputs.sentence_index = torch::zeros({1, 1}, torch::kInt64);
  return inputs;
}

bus::Observation Model::Trial() const {
  const auto& fits = metadata_.embodiment;
  const codec::Region crop = policy::CropOf(metadata_.policy.image);
  bus::Observation trial;
  trial.run = metadata_.run;
  trial.session = "trial";
  trial.instruction = "pick up the red can";
  trial.joints.assign(static_cast<std::size_t>(fits.joints), 0.0F);
  // schema 1 does not say how large pictures are
  trial.width = static_cast<std::uint32_t>(fits.width > 0 ? fits.width : crop.u + crop.width);
  trial.height = static_cast<std::uint32_t>(fits.height > 0 ? fits.height : crop.v + crop.height);
  if (policy::ReadsCamera(metadata_.policy)) {
    const double focal = fits.fovy > 0 ? 0.5 * trial.height / std::tan(0.5 * fits.fovy) : trial.height;
    trial.intrinsics = {focal, focal, 0.5 * trial.width, 0.5 * trial.height};
    trial.camera_pose = fits.camera_pose;
    if (trial.camera_pose.empty()) trial.camera_pose = {0, 0, 1, 1, 0, 0, 0};  // from above, straight down
  }
  trial.image.assign(static_cast<std::size_t>(trial.width) * trial.height * 3, 128);
  return trial;
}

bus::Action Model::Answer(const bus::Observation& observation) const {
  bus::Action action;
  action.run = observation.run;
  action.run_id = observation.run_id;
  action.rotation = kRotationFormat;
  action.session = observation.session;
  action.request_id = observation.request_id;
  action.checkpoint_step = metadata_.step;
  action.checkpoint_sha256 = sha256_;
  if (!untrained_.empty()) {
    action.error = checkpoint::CheckTrained(metadata_).error().message;
    action.refusal = bus::Refusal::kNotTrained;
    return action;
  }
  try {
    const auto inputs = Prepare(observation);
    if (!inputs) {
      action.error = inputs.error().message;
      action.refusal = bus::Refusal::kDoesNotFit;
      return action;
    }
    const torch::NoGradGuard no_grad;
    const auto outputs = policy_->Forward(*inputs);
    action.modules_json = policy::DescribeModules(metadata_.policy, outputs).dump();
    action.waypoints = policy::WaypointsOf(metadata_.policy, outputs);
    if (static_cast<int>(action.waypoints.size()) != kWaypoints * kWaypointSize)
      action.error = "this policy has no module that decodes a trajectory";
    else if (!std::all_of(action.waypoints.begin(), action.waypoints.end(), [](float x) { return std::isfinite(x); }))
      action.error = "the policy's answer is not finite";
    if (!action.error.empty()) action.refusal = bus::Refusal::kFailed;
  } catch (const std::exception& error) {
    action.error =
        policy::TorchError("evaluate the policy", error).message;  // a device's memory may be there again later
  }
  if (!action.error.empty()) action.waypoints.clear();
  return action;
}

}  // namespace etude::serve
