// SPDX-License-Identifier: Apache-2.0
#include "worker/work.h"

#include <fmt/format.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "services/bus/process_reporter.h"
#include "services/campaign/process.h"
#include "services/core/log.h"
#include "services/core/service_manager.h"
#include "services/core/stop.h"
#include "services/core/without_throwing.h"
#include "services/episode/codec.h"
#include "services/policy/client.h"
#include "services/spec/attempt_outcome.h"
#include "worker/fingerprint.h"
#include "worker/host/child.h"
#include "worker/host/slot.h"
#include "worker/task/attempt.h"
#include "worker/task/user_files.h"

namespace etude {
namespace {

campaign::WorkResult ResultOf(task::AttemptResult attempt, bool always_complete) {
  campaign::WorkResult result;
  result.outcome = task::ToString(attempt.outcome);
  result.steps = static_cast<std::uint64_t>(attempt.episode.steps());
  for (std::size_t i = 0; i < attempt.episode.cameras.size(); ++i) result.frames += RecordedFrames(attempt.episode, i);
  result.times = {
      .plan_s = attempt.plan_s, .step_s = attempt.step_s, .render_s = attempt.render_s, .deflate_s = attempt.deflate_s};
  if (attempt.outcome == task::AttemptOutcome::kSuccess || always_complete) {
    result.episode = EncodeEpisode(attempt.episode);
    return result;
  }
  OrderedJson details{{"reason", attempt.reason}};
  details.update(attempt.failure);
  details.update(OrderedJson{{"scene", attempt.scene},
                             {"plan_s", attempt.plan_s},
                             {"step_s", attempt.step_s},
                             {"render_s", attempt.render_s},
                             {"deflate_s", attempt.deflate_s}});
  result.details_json = JsonText(details);
  return result;
}

std::function<void(std::string_view, int)> ToProgress(const campaign::WorkItem& item) {
  if (!item.progress) return {};
  return [progress = item.progress](std::string_view stage, int step) {
    progress(stage, static_cast<std::uint32_t>(step));
  };
}

campaign::WorkFunction Demonstrate(std::shared_ptr<task::AttemptRunner> runner) {
  return [runner](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
    runner->OnProgress(ToProgress(item));
    ETUDE_ASSIGN_OR_RETURN(auto attempt, runner->Demonstrate(item.index, item.attempt, item.weights));
    return ResultOf(std::move(attempt), false);
  };
}

campaign::WorkFunction RollOut(std::shared_ptr<task::AttemptRunner> runner, const policy::AskFunction& ask) {
  return [runner, ask](const campaign::WorkItem& item) -> Result<campaign::WorkResult> {
    runner->OnProgress(ToProgress(item));
    bool answers = true;  // the policy
    auto attempt = runner->Rollout(item.index, [&](const policy::Question& question) {
      auto answer = ask(question);
      answers = answer.has_value();
      return answer;
    });
    if (attempt) {
      // without a scene nothing was rolled out
      const bool complete = attempt->outcome != task::AttemptOutcome::kSceneInvalid;
      return ResultOf(std::move(*attempt), complete);
    }
    if (answers) return Fail(attempt.error());  // the machine's fault: no attempt
    // the policy did not answer: not the rollout's failure, it is tried again
    const std::string outcome = StopRequested() ? kReleased : kPolicyError;
    OrderedJson details{{"reason", attempt.error().message}};
    if (attempt.error().code == Code::kInvalidArgument) details[kPolicyRefused] = true;
    return campaign::WorkResult{.outcome = outcome, .details_json = JsonText(details)};
  };
}

// @param session  unique among all who ask
Result<policy::AskFunction> AskOf(const bus::Participant& participant, const campaign::JoinedCampaign& joined,
                                  const std::string& session) {
  ETUDE_ASSIGN_OR_RETURN(auto policy, policy::Client::Open(participant, joined.policy, session));
  return [client = std::make_shared<policy::Client>(std::move(policy))](const policy::Question& question) {
    return client->Ask(question);
  };
}

// Attempts of a campaign in this process.
// @param ask_of  who answers a rollout's questions; called in mode rollout only
Result<campaign::WorkFunction> AttemptsOf(const CampaignSpec& spec, const sim::RendererConfig& renderer,
                                          const std::function<Result<policy::AskFunction>()>& ask_of) {
  ETUDE_ASSIGN_OR_RETURN(auto opened, task::AttemptRunner::Open(spec, renderer));
  auto runner = std::make_shared<task::AttemptRunner>(std::move(opened));
  if (spec.mode != "rollout") return Demonstrate(runner);
  ETUDE_ASSIGN_OR_RETURN(const policy::AskFunction ask, ask_of());
  return RollOut(runner, ask);
}

// The worker's options with what its bytes depend on; both are borrowed.
campaign::WorkerOptions OptionsOf(const WorkArguments& arguments, task::UserFiles& files, Fingerprints& fingerprints) {
  campaign::WorkerOptions options = arguments.worker;
  options.files_sha256 = [&files](const CampaignSpec& spec) { return files.Sha256(spec); };
  options.fingerprint = [&fingerprints](const CampaignSpec& spec) { return fingerprints.Of(spec); };
  return options;
}

// One slot of a host, on a thread of its own: a worker on the bus whose attempts a child makes.
Status WorkInSlot(const WorkArguments& arguments, const bus::Participant& participant, host::SlotOptions slot_options,
                  task::UserFiles& files, Fingerprints& fingerprints) {
  campaign::WorkerOptions options = OptionsOf(arguments, files, fingerprints);
  options.name = slot_options.name;
  options.prefetch = true;
  ETUDE_ASSIGN_OR_RETURN(auto client, campaign::WorkerClient::Open(participant, options));
  host::Slot slot(std::move(slot_options));
  return client.Run([&](const campaign::JoinedCampaign& joined) -> Result<campaign::WorkFunction> {
    ETUDE_RETURN_IF_ERROR(slot.Begin(joined));
    policy::AskFunction ask;
    if (joined.spec.mode == "rollout") {
      ETUDE_ASSIGN_OR_RETURN(ask, AskOf(participant, joined, client.name()));
    }
    return [&slot, ask](const campaign::WorkItem& item) { return slot.Do(item, ask); };
  });
}

// A child may be started days after its host, from files that were replaced meanwhile.
Status CheckAsItsHost(const campaign::JoinedCampaign& joined, Fingerprints& fingerprints) {
  if (joined.fingerprint.empty() || joined.spec.determinism == "none") return {};
  ETUDE_ASSIGN_OR_RETURN(const auto own, fingerprints.Of(joined.spec));
  const auto difference = campaign::FirstDifference(own, joined.fingerprint, joined.spec.determinism);
  if (!difference) return {};
  return Fail(Code::kUnavailable,
              fmt::format("go on with campaign '{}@{}': what is started now would make other bytes than this host did "
                          "({}): its libraries or driver were replaced; start the worker again",
                          joined.spec.name, joined.id, *difference));
}

}  // namespace

Status Work(const WorkArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kWorker}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter, bus::ProcessReporter::Start(participant, {.role = "worker"}));
  task::UserFiles files;
  Fingerprints fingerprints(arguments.renderer);
  const campaign::WorkerOptions options = OptionsOf(arguments, files, fingerprints);
  ETUDE_ASSIGN_OR_RETURN(auto client, campaign::WorkerClient::Open(participant, options));
  ServiceManager::Get().Ready(fmt::format("looking for campaign {}", options.campaign));
  return client.Run([&](const campaign::JoinedCampaign& joined) -> Result<campaign::WorkFunction> {
    const CampaignSpec& spec = joined.spec;
    ETUDE_ASSIGN_OR_RETURN(
        auto attempts, AttemptsOf(spec, arguments.renderer, [&] { return AskOf(participant, joined, client.name()); }));
    Log().info("joined campaign={}@{} mode={} worker={}", spec.name, joined.id, spec.mode, client.name());
    ServiceManager::Get().Say(fmt::format("campaign {}@{} as {}", spec.name, joined.id, client.name()));
    return attempts;
  });
}

Status BeChild(const WorkArguments& arguments) {
  Fingerprints fingerprints(arguments.renderer);
  return host::ServeHost(
      host::Channel(host::kHostDescriptor),
      [&](const campaign::JoinedCampaign& joined, const policy::AskFunction& ask) -> Result<campaign::WorkFunction> {
        ETUDE_RETURN_IF_ERROR(CheckAsItsHost(joined, fingerprints));
        return AttemptsOf(joined.spec, arguments.renderer, [&]() -> Result<policy::AskFunction> { return ask; });
      });
}

Status Host(const WorkArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kWorker}));
  ETUDE_ASSIGN_OR_RETURN(const auto reporter, bus::ProcessReporter::Start(participant, {.role = "worker"}));
  ETUDE_ASSIGN_OR_RETURN(const Path program, campaign::FindSibling("etude-worker"));
  task::UserFiles files;
  Fingerprints fingerprints(arguments.renderer);
  const std::string name = arguments.worker.name.empty() ? bus::UniquePeerName() : arguments.worker.name;
  host::SlotOptions options;
  options.argv = {program.string(), "--child", "--gl", arguments.renderer.backend};
  if (arguments.bus.log != "text") options.argv.insert(options.argv.end(), {"--log", arguments.bus.log});
  options.hopeless = campaign::HopelessDeaths(arguments.slots);
  options.stall = std::chrono::milliseconds(static_cast<std::int64_t>(1000 * arguments.stall_s));
  ServiceManager::Get().Ready(fmt::format("looking for campaign {}", arguments.worker.campaign));
  std::vector<Status> ended(static_cast<std::size_t>(arguments.slots));
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < ended.size(); ++k) {
    options.name = fmt::format("{}-s{}", name, k);
    const auto work = [&, k, options] {
      ended[k] = WithoutThrowing([&] { return WorkInSlot(arguments, participant, options, files, fingerprints); });
      if (!ended[k]) RequestStop();
    };
    const Status started = WithoutThrowing([&]() -> Status { return threads.emplace_back(work), Status(); });
    if (started) continue;
    ended[k] = Fail(started.error().Wrap(fmt::format("start slot {} of {}", k + 1, arguments.slots)));
    RequestStop();
    break;
  }
  for (auto& thread : threads) thread.join();
  for (const Status& status : ended)
    if (!status) return status;
  return {};
}

}  // namespace etude
