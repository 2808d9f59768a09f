// SPDX-License-Identifier: Apache-2.0
#include "services/cli/top_json.h"

#include <fmt/format.h>

#include "services/cli/top_text.h"
#include "services/episode/bounded_json.h"

namespace etude::cli {
namespace {

OrderedJson WorkerJson(const Heard<bus::WorkerStatus>& heard, MonotonicClock::time_point now) {
  const bus::WorkerStatus& status = heard.message;
  OrderedJson json{{"worker", status.worker}, {"host", status.host}, {"phase", status.phase}};
  json["index"] = status.token == 0 ? OrderedJson() : OrderedJson(status.index);
  json["attempt"] = status.token == 0 ? OrderedJson() : OrderedJson(status.attempt);
  json["stage"] = status.stage;
  json["step"] = status.step;
  json["episodes"] = status.episodes;
  json["failures"] = status.failures;
  json["steps_per_second"] = status.steps_per_second;
  json["last_outcome"] = status.last_outcome;
  json["heard_s"] = heard.AgeSeconds(now);
  return json;
}

OrderedJson PolicyJson(const Heard<bus::PolicyStatus>& heard, MonotonicClock::time_point now) {
  const bus::PolicyStatus& status = heard.message;
  return {{"server", status.server},
          {"host", status.host},
          {"step", status.step},
          {"sha256", status.sha256},
          {"sessions", status.sessions},
          {"answered", status.answered},
          {"refused", status.refused},
          {"last_refusal", status.last_refusal},
          {"p50_ms", status.p50_ms},
          {"p95_ms", status.p95_ms},
          {"heard_s", heard.AgeSeconds(now)}};
}

OrderedJson RunJson(const RunView& run, MonotonicClock::time_point now) {
  OrderedJson json{{"name", run.name}, {"id", run.id}, {"heard_s", nullptr}};
  if (run.status) {
    const bus::TrainStatus& status = run.status->message;
    json["heard_s"] = run.status->AgeSeconds(now);
    json["step"] = status.step;
    json["stage"] = status.stage;
    json["stages"] = status.stages;
    json["stage_name"] = status.stage_name;
    json["finished"] = status.finished;
    json["loss"] = status.loss;
    json["samples_per_second"] = status.samples_per_second;
    json["data_wait"] = status.data_wait;
    json["episodes"] = status.episodes;
    json["metrics"] = ParseBoundedJson(status.metrics_json, 2).value_or(OrderedJson::object());
  }
  json["policies"] = OrderedJson::array();
  for (const auto& [server, heard] : run.policies) json["policies"].push_back(PolicyJson(heard, now));
  return json;
}

}  // namespace

OrderedJson StatusJson(const CampaignView& campaign) {
  OrderedJson json{{"name", campaign.presence.name},     {"id", campaign.presence.id},
                   {"host", campaign.presence.host},     {"user", campaign.presence.user},
                   {"folder", campaign.presence.folder}, {"since", campaign.presence.since}};
  if (campaign.presence.shards > 1)
    json["shard"] = fmt::format("{}/{}", campaign.presence.shard, campaign.presence.shards);
  if (!campaign.status) return json;
  const bus::CampaignStatus& status = campaign.status->message;
  json["state"] = status.state;
  json["committed"] = status.committed;
  json["total"] = status.total;
  json["attempts"] = status.attempts;
  json["given_up"] = status.given_up;
  json["workers"] = status.workers;
  json["episodes_per_minute"] = status.episodes_per_minute;
  json["eta_s"] = status.eta_s;
  json["failures"] = ParseBoundedJson(status.failures_json, 2).value_or(OrderedJson::object());
  json["error"] = status.error;
  json["rechecked"] = status.rechecked;
  json["mismatched"] = status.mismatched;
  return json;
}

OrderedJson TopJson(const BusView& view, MonotonicClock::time_point now) {
  OrderedJson campaigns = OrderedJson::array(), runs = OrderedJson::array();
  for (const auto& [id, campaign] : view.campaigns) {
    OrderedJson json = StatusJson(campaign);
    json["heard_s"] = campaign.status ? OrderedJson(campaign.status->AgeSeconds(now)) : OrderedJson();
    OrderedJson workers = OrderedJson::array();
    for (const auto& [name, heard] : campaign.workers)
      if (heard.message.phase != bus::kGonePhase) workers.push_back(WorkerJson(heard, now));
    json["worker_list"] = std::move(workers);
    campaigns.push_back(std::move(json));
  }
  for (const auto& [id, run] : view.runs) runs.push_back(RunJson(run, now));
  return {{"domain", view.domain},
          {"sentence", StateSentence(view, now)},
          {"campaigns", std::move(campaigns)},
          {"runs", std::move(runs)}};
}

}  // namespace etude::cli
