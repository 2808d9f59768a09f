// SPDX-License-Identifier: Apache-2.0
// A child's side: makes what its host asks for, until the host has gone.
#pragma once

#include <functional>

#include "services/campaign/worker_client.h"
#include "services/policy/policy_types.h"
#include "worker/host/frame.h"

namespace etude::host {

/// The descriptor on which a child finds its host.
inline constexpr int kHostDescriptor = 3;

/// Makes the function for a campaign; rollouts ask their policy through `ask`, which the host answers.
using ChildFactory = std::function<Result<campaign::WorkFunction>(const campaign::JoinedCampaign& joined,
                                                                  const policy::AskFunction& ask)>;

/// Serves until the host closes its end, which is success, or a stop is requested. What the factory or the function
/// returns as an error is the host's to judge: it is told, and the child goes on.
/// @error kCorrupt: what came is not what a host says.
Status ServeHost(Channel channel, const ChildFactory& factory);

}  // namespace etude::host
