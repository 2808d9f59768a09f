// SPDX-License-Identifier: Apache-2.0
// A worker at work: attempts for a campaign, in this process, as a host's child, or as a host of slots.
#pragma once

#include "services/bus/arguments.h"
#include "services/campaign/worker_client.h"
#include "services/core/cores.h"
#include "services/core/result.h"
#include "worker/sim/renderer.h"

namespace etude {

struct WorkArguments {
  campaign::WorkerOptions worker;  ///< without files_sha256 and fingerprint, which are filled in
  bus::Arguments bus;
  sim::RendererConfig renderer;
  int slots = Cores();  ///< 0: this process makes the episodes itself
  double stall_s = 90;  ///< with slots: a child that works and says nothing for so long is replaced
};

/// Joins the campaign and makes its attempts in this process, one at a time. Ends as WorkerClient::Run.
/// @error of the bus; as WorkerClient::Run
Status Work(const WorkArguments& arguments);

/// Makes what the host at the other end of descriptor 3 asks for. @error as host::ServeHost
Status BeChild(const WorkArguments& arguments);

/// Joins the campaign with `slots` workers, each on a thread of its own; their children (BeChild) make the attempts.
/// One participant for all slots. A slot that ends with an error ends its host: what refused it refuses the others.
/// @error of the bus; of the first slot that has one
Status Host(const WorkArguments& arguments);

}  // namespace etude
