// SPDX-License-Identifier: Apache-2.0
// A checkpoint that answers observations.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "services/bus/messages.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/policy/clip/text_encoder.h"

namespace etude::serve {

/// Whose pictures are taken.
enum class Cameras : std::uint8_t {
  kTrained,  ///< of the camera that the policy was trained with; others are refused by name
  kAny,      ///< to see what another one costs it
};

/// Immutable; Answer may be called from several threads at once.
class Model {
 public:
  /// @param folders  as of checkpoint::BuildPolicy @param device  where it computes
  /// @error as checkpoint::Decode and checkpoint::BuildPolicy; kUnavailable: the device has no room for it.
  static Result<std::shared_ptr<const Model>> FromBytes(std::span<const std::uint8_t> bytes,
                                                        clip::Folders* folders = nullptr,
                                                        const torch::Device& device = torch::kCPU,
                                                        Cameras cameras = Cameras::kTrained);
  static Result<std::shared_ptr<const Model>> FromFile(const Path& path, clip::Folders* folders = nullptr,
                                                       const torch::Device& device = torch::kCPU,
                                                       Cameras cameras = Cameras::kTrained);

  const checkpoint::Metadata& metadata() const { return metadata_; }
  /// Why it may not drive a robot yet (checkpoint::WhyUntrained); "" when it may.
  const std::string& untrained() const { return untrained_; }
  const std::string& sha256() const { return sha256_; }

  /// An observation that fits, of nothing: for measuring how long an answer takes.
  bus::Observation Trial() const;
  /// Waypoints and the modules' outputs. An observation that does not fit what the policy was trained for (each
  /// difference by name), a sentence that it cannot read, or any while a module on the control path is untrained, is
  /// answered with `error` set and nothing else. A pure function of the observation and the checkpoint.
  bus::Action Answer(const bus::Observation& observation) const;

  /// What every module says of the observation, where it looks, and the picture that it sees; with a what-if
  /// (trainer/policy/what_if.h) also what it would say, and what words and joints are worth. Not for robots: it says
  /// what untrained modules say too.
  bus::Insight Inspect(const bus::Observation& observation, const std::string& what_if_json) const;

 private:
  Model() = default;
  Result<policy::Inputs> Prepare(const bus::Observation& observation) const;
  Status InspectInto(const bus::Observation& observation, const std::string& what_if_json, bus::Insight& insight) const;

  checkpoint::Metadata metadata_;
  std::string sha256_, untrained_;
  std::shared_ptr<policy::Policy> policy_;
};

}  // namespace etude::serve
