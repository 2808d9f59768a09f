// SPDX-License-Identifier: Apache-2.0
// What tests of the conversation between a collector and its workers share.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <utility>

#include "services/bus/blob_transfer.h"
#include "services/bus/topic.h"
#include "services/campaign/collector.h"
#include "services/episode/codec.h"

namespace etude::campaign {

using namespace std::chrono_literals;

inline CollectorOptions QuickOptions() {
  CollectorOptions options;
  options.lease = 3s;
  options.status_every = 100ms;
  options.retry_commit = 50ms;
  options.index_every = 500ms;
  options.away = 0ms;
  return options;
}

// A collector on a thread of its own.
class Running {
 public:
  explicit Running(Collector collector)
      : collector_(std::move(collector)), thread_([this] { status_ = collector_.Run(); }) {}
  ~Running() { Stop(); }
  void Stop() {
    collector_.Stop();
    Join();
  }
  void Join() {
    if (thread_.joinable()) thread_.join();
  }
  Collector& operator*() { return collector_; }
  Collector* operator->() { return &collector_; }
  const Status& status() const { return status_; }

 private:
  Collector collector_;
  Status status_;
  std::thread thread_;
};

inline std::string PartitionOf(Running& running, const CampaignSpec& spec) {
  return bus::Owner{spec.name, running->id()}.partition();
}

// A worker by hand, to say things that a good one does not.
class RawWorker {
 public:
  RawWorker(const bus::Participant& participant, const CampaignSpec& spec, const std::string& id,
            const std::string& name, const std::string& files_sha256 = "")
      : partition_(bus::Owner{spec.name, id}.partition()),
        requests_(std::move(*bus::Writer<bus::WorkRequest>::Open(participant, partition_))),
        reports_(std::move(*bus::Writer<bus::AttemptReport>::Open(participant, partition_))),
        leases_(std::move(
            *bus::Reader<bus::Lease>::Open(participant, bus::PartitionOfAddress(partition_, participant.address())))),
        sender_(std::move(*bus::BlobSender::Open(participant, bus::Owner{spec.name, id}, "episode", name))) {
    request.campaign = spec.name;
    request.campaign_id = id;
    request.spec_sha256 = SpecHash(spec);
    request.worker = name;
    request.host = participant.address();
    request.content = kContentVersion;
    request.files_sha256 = files_sha256;
    (void)requests_.WaitForReaders(1, std::chrono::seconds(20));  // or the first request is lost
  }

  bus::Lease Ask() {
    for (int i = 0; i < 5; ++i) {
      ++request.request_id;
      (void)requests_.Write(request);
      // answers to what was asked before come late on a busy machine: only this one counts
      for (const auto deadline = std::chrono::steady_clock::now() + 2s; std::chrono::steady_clock::now() < deadline;) {
        leases_.Wait(200ms);
        for (const auto& lease : leases_.Take())
          if (lease.worker == request.worker && lease.request_id == request.request_id) return lease;
      }
    }
    ADD_FAILURE() << "no answer";
    return {};
  }
  bus::Verdict Send(const bus::Lease& lease, const Episode& episode) {
    auto verdict = sender_.Send(++object_, EncodeEpisode(episode), lease.token, "{}", 20s);
    EXPECT_TRUE(verdict) << (verdict ? "" : verdict.error().message);
    return verdict.value_or(bus::Verdict{bus::AckKind::kProgress, ""});
  }
  void Report(const bus::Lease& lease, const std::string& id, const std::string& spec_sha256,
              const std::string& outcome = "plan_failed", const std::string& details_json = "") {
    bus::AttemptReport report;
    report.campaign = request.campaign;
    report.campaign_id = id;
    report.spec_sha256 = spec_sha256;
    report.worker = request.worker;
    report.index = lease.index;
    report.attempt = lease.attempt;
    report.token = lease.token;
    report.outcome = outcome;
    report.details_json = details_json;
    EXPECT_TRUE(reports_.Write(report));
  }

  bus::WorkRequest request;

 private:
  std::string partition_;
  bus::Writer<bus::WorkRequest> requests_;
  bus::Writer<bus::AttemptReport> reports_;
  bus::Reader<bus::Lease> leases_;
  bus::BlobSender sender_;
  std::uint64_t object_ = 0;
};

}  // namespace etude::campaign
