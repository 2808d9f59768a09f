// SPDX-License-Identifier: Apache-2.0
#include "services/campaign/hosted_collector.h"

#include "services/campaign/spec_file.h"
#include "services/core/log.h"
#include "services/core/without_throwing.h"

namespace etude::campaign {

Result<std::unique_ptr<HostedCollector>> HostedCollector::Start(const bus::Participant& participant,
                                                                const std::string& spec_file, const Path& dataset,
                                                                const CollectorOptions& options) {
  SpecArguments arguments;
  arguments.file = spec_file;
  ETUDE_ASSIGN_OR_RETURN(const auto spec, LoadSpec(arguments));
  ETUDE_ASSIGN_OR_RETURN(auto collector, Collector::Open(participant, spec, dataset, options));
  return std::unique_ptr<HostedCollector>(new HostedCollector(std::move(collector)));
}

HostedCollector::HostedCollector(Collector collector)
    : collector_(std::move(collector)), thread_([this] {
        const Status ended = WithoutThrowing([this] { return collector_.Run(); });
        if (!ended) {
          Log().error("the collector stopped: {}", ended.error().message);
          const MutexLock lock(mutex_);
          status_ = Fail(ended.error().Wrap("the collector stopped"));
        }
        ended_ = true;  // last: who sees it finds the status
      }) {}

HostedCollector::~HostedCollector() {
  collector_.Stop();
  thread_.join();
}

Status HostedCollector::status() const {
  const MutexLock lock(mutex_);
  return status_;
}

}  // namespace etude::campaign
