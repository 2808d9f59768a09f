// SPDX-License-Identifier: Apache-2.0
// What goes on on a domain, from the topics that say so: campaigns, their workers, runs, policy servers, processes.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/bus/messages.h"
#include "services/bus/participant.h"
#include "services/core/clock.h"
#include "services/core/result.h"
#include "services/monitor/topics.h"

namespace etude::cli {

using monitor::Heard;

struct CampaignView {
  bus::Presence presence;
  std::optional<Heard<bus::CampaignStatus>> status;
  std::map<std::string, Heard<bus::WorkerStatus>> workers;  ///< by name
};

struct RunView {
  std::string name, id;
  std::optional<Heard<bus::TrainStatus>> status;
  std::map<std::string, Heard<bus::PolicyStatus>> policies;  ///< that serve it, by server
};

struct BusView {
  std::uint32_t domain = 0;
  std::map<std::string, CampaignView> campaigns;  ///< by id, those that are live
  std::map<std::string, RunView> runs;            ///< by id: trained or served now
  monitor::Processes processes;
};

/// Listens from its opening on. It is there for people: it reads no bulk topic. One thread at a time.
class BusWatch {
 public:
  static Result<BusWatch> Open(const bus::Participant& participant);
  BusWatch(BusWatch&&) noexcept;
  BusWatch& operator=(BusWatch&&) noexcept;
  ~BusWatch();

  /// Takes what came. What is gone leaves the view; a worker or process that is silent for a minute does, too.
  /// @error of the bus
  Status Look();
  const BusView& view() const;
  /// Looks again and again for `patience`, or until a stop request: who is there speaks once a second.
  Status LookAround(std::chrono::milliseconds patience);

 private:
  struct Impl;
  explicit BusWatch(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace etude::cli
