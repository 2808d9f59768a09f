// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/server.h"

#include <fmt/format.h>

#include <memory>
#include <thread>
#include <utility>

#include "services/bus/access.h"
#include "services/bus/topic.h"
#include "services/core/identity.h"
#include "services/core/log.h"
#include "services/core/thread_annotations.h"
#include "services/core/without_throwing.h"
#include "trainer/serve/server_impl.h"

namespace etude::serve {

using internal::Front;

PolicyServer::PolicyServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PolicyServer::PolicyServer(PolicyServer&&) noexcept = default;
PolicyServer& PolicyServer::operator=(PolicyServer&&) noexcept = default;
PolicyServer::~PolicyServer() = default;

Result<PolicyServer> PolicyServer::Open(const bus::Participant& participant, const ServerOptions& options,
                                        std::shared_ptr<const Model> model) {
  if (model && !IsId(options.run.id))
    return Fail(Code::kInvalidArgument,
                fmt::format("serve a checkpoint as '{}': it needs a whole id", options.run.text()));
  if (options.robots && options.robots->domain() == participant.domain())
    return Fail(Code::kInvalidArgument,
                fmt::format("serve robots in DDS domain {}: it is the run's own", participant.domain()));
  auto impl = std::make_unique<Impl>();
  impl->front.participant = &participant;
  if (options.robots) impl->robots.emplace(Front{.participant = options.robots, .insights = false});
  for (Front* front : {&impl->front, impl->robots ? &*impl->robots : nullptr}) {
    if (!front) continue;
    ETUDE_ASSIGN_OR_RETURN(front->known,
                           bus::Writer<bus::Presence>::Open(*front->participant, bus::kDirectoryPartition));
  }
  impl->options = options;
  if (model) impl->Serve(options.run.id, std::move(model));
  return PolicyServer(std::move(impl));
}

Status PolicyServer::Follow() {
  impl_->follower = std::thread([impl = impl_.get()] {
    const Status status = WithoutThrowing([impl] { return impl->FollowRuns(); });
    if (status) return;
    {
      const MutexLock lock(impl->mutex);
      impl->follow_status = status;
    }
    impl->stop = true;
  });
  return {};
}

Status PolicyServer::Run() {
  Impl& impl = *impl_;
  if (!impl.Current().model) Log().info("waiting for the first checkpoint of run '{}'", impl.options.run.text());
  // each in its own thread: who waits for one domain's observations does not hear the other's
  const auto serve = [&impl](Front& at) {
    Status served = WithoutThrowing([&] { return impl.ServeAt(at); });
    impl.stop = true;
    return served;
  };
  Status of_robots;
  std::thread beside;
  if (impl.robots) beside = std::thread([&] { of_robots = serve(*impl.robots); });
  Status served = serve(impl.front);
  if (beside.joinable()) beside.join();
  ETUDE_RETURN_IF_ERROR(served);
  ETUDE_RETURN_IF_ERROR(of_robots);
  const MutexLock lock(impl.mutex);
  return impl.follow_status;
}

void PolicyServer::Stop() { impl_->stop = true; }
std::uint64_t PolicyServer::answered() const { return impl_->answered; }
std::uint64_t PolicyServer::refused_checkpoints() const { return impl_->refused; }
Latency PolicyServer::latency() const { return impl_->latency.Now(); }
std::uint64_t PolicyServer::checkpoint_step() const {
  const auto model = impl_->Current().model;
  return model ? model->metadata().step : 0;
}

}  // namespace etude::serve
