// SPDX-License-Identifier: Apache-2.0
// Every message on the bus as a plain struct. The IDL (proto/*.idl) is the wire format; services/bus
// converts. Topic, key, QoS, writer and reader of each: proto/README.md.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace etude::bus {

// ---- campaign.idl ---------------------------------------------------------------------------------

/// collector -> workers, transient-local, keyed by campaign. What to do, as the resolved spec.
struct CampaignAnnouncement {
  std::string campaign;
  std::string spec_json;    ///< resolved CampaignSpec
  std::string spec_sha256;  ///< SpecHash
  std::string version;      ///< workers of another version refuse to join
  std::uint64_t epoch = 0;  ///< grows with every start of the collector; part of fencing tokens
  bool complete = false;    ///< all committed: workers may go home
};

/// worker -> collector. Also renews: a worker repeats it until answered, with a new request_id each time.
struct WorkRequest {
  std::string campaign;
  std::string worker;  ///< unique: host-pid-random
  std::uint64_t request_id = 0;
  std::string version;
  std::string files_sha256;  ///< of what the worker has under the paths that the spec names; "": it names none
};

enum class LeaseKind : std::uint8_t { kWork = 0, kWait = 1, kDone = 2, kRefused = 3 };

/// collector -> one worker, keyed by worker.
struct Lease {
  std::string campaign;
  std::string worker;
  std::uint64_t request_id = 0;  ///< of the WorkRequest answered
  LeaseKind kind = LeaseKind::kWait;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;        ///< fencing token: strictly growing; older ones are refused
  std::uint64_t duration_ns = 0;  ///< the lease ends this long after the last heartbeat that named it
  std::string reason;             ///< for kRefused
};

/// worker -> all, keyed by worker, twice a second: heartbeat of the lease it holds, and telemetry.
struct WorkerStatus {
  std::string campaign;
  std::string worker;
  std::string host;
  std::string phase;  ///< idle | plan | play | send
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;     ///< 0: holds no lease
  std::uint64_t episodes = 0;  ///< acknowledged since start
  std::uint64_t failures = 0;
  double steps_per_second = 0;
  double frames_per_second = 0;
};

/// worker -> collector: an attempt that produced no episode, and why. Answered by the next Lease.
struct AttemptReport {
  std::string campaign;
  std::string worker;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;
  std::string outcome;  ///< typed reason
  std::string details_json;
};

/// collector -> all, keyed by campaign, once a second.
struct CampaignStatus {
  std::string campaign;
  std::uint64_t committed = 0;
  std::uint64_t total = 0;
  std::uint64_t attempts = 0;  ///< committed + failed
  std::uint64_t given_up = 0;  ///< indices whose attempts are used up
  std::uint32_t workers = 0;
  double episodes_per_minute = 0;
  double eta_s = 0;
  std::string failures_json;  ///< {"reason": count}
  std::string error;          ///< e.g. disk full: committing waits
};

// ---- object.idl: chunked objects (services/bus/object_channel.h) -----------------------------------

/// Announces one object; everything needed to verify it.
struct ObjectManifest {
  std::string channel;  ///< e.g. "episode", or a run's "latest"
  std::string sender;
  std::uint64_t id = 0;  ///< unique for (channel, sender)
  std::uint64_t size = 0;
  std::uint32_t chunk_size = 0;
  std::uint32_t chunk_count = 0;
  std::vector<std::uint8_t> sha256;  ///< 32 bytes; empty when `crc32c` is used instead
  std::vector<std::uint8_t> crc32c;  ///< 4 bytes, little-endian: what streams of frames use
  std::uint64_t token = 0;           ///< fencing token of the lease; 0 if none
  std::string meta_json;
  std::vector<std::uint8_t> data;  ///< the whole object when it fits into one chunk, else empty
};

struct ObjectChunk {
  std::string channel;
  std::string sender;
  std::uint64_t id = 0;
  std::uint32_t index = 0;
  std::vector<std::uint8_t> data;  ///< <= 512 KiB
};

enum class AckKind : std::uint8_t { kProgress = 0, kDone = 1, kDuplicate = 2, kRefused = 3, kMissing = 4 };

struct ObjectAck {
  std::string channel;
  std::string sender;  ///< whose object
  std::uint64_t id = 0;
  AckKind kind = AckKind::kProgress;
  std::uint32_t received = 0;  ///< chunks received in order from 0 (opens the sender's window)
  std::vector<std::uint32_t> missing;
  std::string reason;               ///< for kRefused
  std::vector<std::uint64_t> also;  ///< more ids of the same sender with the same answer
};

// ---- policy.idl -----------------------------------------------------------------------------------

/// robot (worker) -> policy server.
struct Observation {
  std::string run;
  std::string session;  ///< one per client
  std::uint64_t request_id = 0;
  std::string instruction;
  std::vector<float> joints;  ///< arm joints then gripper joint(s)
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<std::uint8_t> image;  ///< RGB, height*width*3, top row first
};

/// policy server -> robot, keyed by session.
struct Action {
  std::string run;
  std::string session;
  std::uint64_t request_id = 0;
  std::string error;  ///< not empty: the observation was refused
  std::uint64_t checkpoint_step = 0;
  std::string checkpoint_sha256;
  std::vector<float> waypoints;  ///< kWaypoints * kWaypointSize, absolute, SI (episode/action.h)
  std::string modules_json;      ///< decoded output of every module, for people and for metrics
};

// ---- train.idl ------------------------------------------------------------------------------------

/// trainer -> all, keyed by run, once a second.
struct TrainStatus {
  std::string run;
  std::uint64_t step = 0;
  std::uint32_t stage = 0;
  std::uint32_t stages = 0;
  std::string stage_name;
  double loss = 0;
  double samples_per_second = 0;
  double data_wait = 0;        ///< fraction of the step spent waiting for data
  std::uint64_t episodes = 0;  ///< in the training split now
  double eta_s = 0;
  std::uint64_t checkpoint_step = 0;
  std::string metrics_json;  ///< validation error per module etc.
  bool finished = false;
};

}  // namespace etude::bus
