// SPDX-License-Identifier: Apache-2.0
#include "trainer/serve/server.h"

#include <fmt/format.h>

#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "services/bus/topic.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude::serve {

using namespace std::chrono_literals;

struct PolicyServer::Impl {
  const bus::Participant* participant = nullptr;
  ServerOptions options;
  std::optional<bus::Writer<bus::Action>> writer;
  std::optional<bus::Reader<bus::Observation>> reader;
  std::optional<bus::ObjectSubscriber> subscriber;
  std::thread follower;
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> answered{0}, refused{0};

  mutable std::mutex mutex;
  std::shared_ptr<const Model> model;

  ~Impl() {
    stop = true;
    if (follower.joinable()) follower.join();
  }
  std::shared_ptr<const Model> Current() const {
    const std::lock_guard lock(mutex);
    return model;
  }
  void FollowCheckpoints();
  Status AnswerAll(const std::vector<bus::Observation>& observations);
};

// every new checkpoint becomes the model, or is refused and the last good one stays
void PolicyServer::Impl::FollowCheckpoints() {
  while (!stop && !StopRequested()) {
    const auto object = subscriber->Wait(200ms);
    if (!object || object->channel != options.channel) continue;
    auto fresh = Model::FromBytes(object->bytes);
    if (!fresh) {
      ++refused;
      const auto kept = Current();
      Log().warn("refused a checkpoint run={} version={}: {}; {}", options.run, object->version, fresh.error().message,
                 kept ? fmt::format("step {} serves on", kept->info().step) : "none serves yet");
      continue;
    }
    Log().info("serving run={} step={} stage={} sha256={:.12}", options.run, (*fresh)->info().step,
               (*fresh)->info().stage_name, (*fresh)->sha256());
    const std::lock_guard lock(mutex);
    model = std::move(*fresh);
  }
}

Status PolicyServer::Impl::AnswerAll(const std::vector<bus::Observation>& observations) {
  // a client that asked again wants the answer to its last question only
  std::map<std::string, const bus::Observation*> newest;
  for (const auto& observation : observations) newest[observation.session] = &observation;
  std::vector<const bus::Observation*> open;
  for (const auto& [session, observation] : newest) open.push_back(observation);

  const auto current = Current();
  std::vector<bus::Action> actions(open.size());
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < open.size(); i = next++) actions[i] = current->Answer(*open[i]);
  };
  std::vector<std::thread> others;
  const std::size_t helpers = std::min(open.size(), static_cast<std::size_t>(options.threads));
  for (std::size_t t = 1; t < helpers; ++t) others.emplace_back(work);
  work();
  for (auto& thread : others) thread.join();

  for (const auto& action : actions) {
    if (!action.error.empty()) Log().warn("refused an observation session={}: {}", action.session, action.error);
    const Status written = writer->Write(action);
    // a client that went away must not stop the others
    if (!written)
      Log().warn("answer session={}: {}", action.session, written.error().message);
    else
      ++answered;
  }
  return {};
}

PolicyServer::PolicyServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PolicyServer::PolicyServer(PolicyServer&&) noexcept = default;
PolicyServer& PolicyServer::operator=(PolicyServer&&) noexcept = default;
PolicyServer::~PolicyServer() = default;

Result<PolicyServer> PolicyServer::Open(const bus::Participant& participant, const ServerOptions& options,
                                        std::shared_ptr<const Model> model) {
  auto impl = std::make_unique<Impl>();
  impl->participant = &participant;
  impl->options = options;
  impl->model = std::move(model);
  ETUDE_ASSIGN_OR_RETURN(impl->writer, bus::Writer<bus::Action>::Open(participant, options.run));
  return PolicyServer(std::move(impl));
}

Status PolicyServer::Follow() {
  ETUDE_ASSIGN_OR_RETURN(impl_->subscriber,
                         bus::ObjectSubscriber::Open(*impl_->participant, impl_->options.run, impl_->options.channel));
  impl_->follower = std::thread([impl = impl_.get()] { impl->FollowCheckpoints(); });
  return {};
}

Status PolicyServer::Run() {
  if (!impl_->Current()) Log().info("waiting for the first checkpoint of run '{}'", impl_->options.run);
  while (!impl_->Current() && !impl_->stop && !WaitForStop(50ms)) {
  }
  if (impl_->stop || StopRequested()) return {};
  ETUDE_ASSIGN_OR_RETURN(impl_->reader, bus::Reader<bus::Observation>::Open(*impl_->participant, impl_->options.run));
  while (!impl_->stop && !StopRequested())
    if (impl_->reader->Wait(100ms)) ETUDE_RETURN_IF_ERROR(impl_->AnswerAll(impl_->reader->Take()));
  return {};
}

void PolicyServer::Stop() { impl_->stop = true; }
std::uint64_t PolicyServer::answered() const { return impl_->answered; }
std::uint64_t PolicyServer::refused_checkpoints() const { return impl_->refused; }
std::uint64_t PolicyServer::checkpoint_step() const {
  const auto model = impl_->Current();
  return model ? model->info().step : 0;
}

}  // namespace etude::serve
