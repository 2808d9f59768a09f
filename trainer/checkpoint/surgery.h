// SPDX-License-Identifier: Apache-2.0
// A new network from parts (trainer/policy/parts.h) of a trained one.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "trainer/checkpoint/checkpoint.h"
#include "trainer/policy/torch.h"

namespace etude::checkpoint {

/// What is to be done, by parts' names.
struct SurgeryPlan {
  std::vector<std::string> copy;    ///< empty: every part that both have but `fresh`, and but what knows another robot
  std::vector<std::string> fresh;   ///< begins anew
  std::vector<std::string> freeze;  ///< stays as it is copied
  std::vector<std::string> like;    ///< "OBST2D=TAR2D": a fresh part begins as another one of the source does
};

/// What was done.
struct Surgery {
  std::set<std::string> copied, fresh;  ///< every part is in one of them
  /// Of fresh parts that begin like another: which, and how many of their tensors. Whatever has another size, or is of
  /// inputs that the other has not, begins anew. A fresh module's own image encoder ("OBST2D.image") begins as the
  /// source's image encoder where they are built alike.
  std::map<std::string, std::pair<std::string, int>> alike;
  /// Of copied modules that read more than their originals: what, by module. Decoders' new columns are zero, so that
  /// at first a copy decodes from new inputs what its original did without them.
  std::map<std::string, std::vector<std::string>> grown;
  /// Of copied modules those that the source had not begun to train: they are as they were drawn.
  std::set<std::string> untrained;
  /// Of attention that is shared and frozen: the modules that learn and use it as it is.
  std::map<std::string, std::vector<std::string>> frozen_attention;
  /// Of frozen modules that read what learns: what. They stay as they are bit for bit, and their answers move with it.
  std::map<std::string, std::vector<std::string>> moved;
  std::vector<std::string> differences;          ///< of robot, camera and formats (embodiment.h), for people
  std::map<std::string, torch::Tensor> tensors;  ///< of the whole network, as Policy::StateTensors
};

/// The network of `config` (resolved, valid) that begins as `initial`, Policy::StateTensors of it. With each copied
/// part come the source's statistics of what it decodes and reads (policy::StatisticsOf), and no others. @param here
/// what the network will be trained for
/// @error kInvalidArgument: names that are no parts; every part that does not fit, with what differs; a part
/// that has nothing of the one it should be like; something frozen that is not copied, that has grown, or that shares
/// attention that is not frozen.
Result<Surgery> Operate(const Checkpoint& source, const SurgeryPlan& plan, const policy::PolicyConfig& config,
                        const std::map<std::string, torch::Tensor>& initial, const Embodiment& here);

/// Of that what needs neither the network nor its data: names that are no parts, copies of what the checkpoint has not,
/// frozen parts that would begin anew, and CheckFreeze. @error as Operate
Status CheckSurgery(const Checkpoint& source, const SurgeryPlan& plan, const policy::PolicyConfig& config);

/// That what is frozen stays what it is: a module computes with the attention that its level shares.
/// @error kInvalidArgument: of frozen modules those whose shared attention learns
Status CheckFreeze(const policy::PolicyConfig& config, const std::vector<std::string>& freeze);

/// Of copied modules those that read, themselves or through others, what begins anew or has grown: what they were
/// measured at was another network.
std::set<std::string> Unsettled(const policy::PolicyConfig& config, const Surgery& surgery);

/// The lowest level at which there is something to learn: that of a module that is fresh, untrained or grown, or that
/// is supervised to attend to, or decodes, what a fresh encoder makes; the last level when nothing is new.
int FirstLevelToLearn(const policy::PolicyConfig& config, const Surgery& surgery);

}  // namespace etude::checkpoint
