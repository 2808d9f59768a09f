// SPDX-License-Identifier: Apache-2.0
// Every message on the bus as a plain struct. The IDL (proto/*.idl) is the wire format; services/bus
// converts. Topic, key, QoS, writer and reader of each: proto/README.md.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace etude::bus {

/// What is written here, as one number: it grows when a peer of the old one would misunderstand. Peers of another
/// number are refused by name; the program's own version does not matter.
/// 3: what is meant for one peer (leases, acknowledgements, actions) is in the partition of its address.
inline constexpr std::uint32_t kWireVersion = 3;

// ---- presence.idl --------------------------------------------------------------------------------

enum class PresenceKind : std::uint8_t { kCampaign = 0, kRun = 1, kPolicy = 2, kRelay = 3 };

/// collector, trainer, policy server, relay -> all, transient-local, keyed by (kind, id, instance): who is there now.
struct Presence {
  PresenceKind kind = PresenceKind::kCampaign;
  std::string id;        ///< of the campaign, or of the run (policy servers and relays: the run they serve)
  std::string instance;  ///< random, of this start
  std::string name;      ///< of the campaign or run, for people; several may have the same
  std::uint32_t wire = kWireVersion;
  std::uint32_t content = 0;  ///< a campaign's: the number of what its episodes' bytes depend on
  std::string version;        ///< of the program, for people
  std::string host, user, folder;
  std::uint64_t since = 0;  ///< of this start, seconds since 1970, for people
  std::uint64_t epoch = 0;  ///< of two with the same id the larger one stays
  /// A campaign's, where several collectors share it: which of them this is, from 1, and how many there are. 0: one has
  /// all of it.
  std::uint32_t shard = 0, shards = 0;
  std::string spec_sha256;  ///< a shard's: those of one campaign have name, `shards` and this in common; else ""
  /// Device and inode of `folder`: two containers of one host name may have folders of one path. "": it is no folder.
  std::string folder_key;
};

// ---- campaign.idl ---------------------------------------------------------------------------------

/// collector -> workers, transient-local, keyed by campaign. What to do, as the resolved spec.
struct CampaignAnnouncement {
  std::string campaign;
  std::string spec_json;    ///< resolved CampaignSpec
  std::string spec_sha256;  ///< SpecHash
  std::string version;      ///< of the program, for people
  std::uint64_t epoch = 0;  ///< grows with every start of the collector; part of fencing tokens
  bool complete = false;    ///< all committed: workers may go home
  std::string campaign_id;
  std::uint32_t wire = kWireVersion;
  std::uint32_t content = 0;  ///< workers of another content number would make other episodes: they do not join
  std::string policy_id;      ///< rollouts ask the policy of this run; "": whoever serves spec.rollout.run
};

/// worker -> collector. Also renews: a worker repeats it until answered, with a new request_id each time.
struct WorkRequest {
  std::string campaign;
  std::string worker;  ///< unique: host-pid-random
  std::uint64_t request_id = 0;
  std::string version;       ///< of the program, for people
  std::string files_sha256;  ///< of what the worker has under the paths that the spec names; "": it names none
  std::string campaign_id;
  std::string spec_sha256;  ///< the spec that the worker is ready for
  std::uint32_t wire = kWireVersion;
  std::uint32_t content = 0;
  std::string fingerprint_json;  ///< what this worker's bytes depend on (services/campaign/fingerprint.h); "": not said
  std::string host;              ///< Participant::address(): in whose partition it reads the answer
  /// Mark (campaign::MarkOf) of the lease that it works on, when it asks for the next one beside it; 0: it has nothing
  /// to do.
  std::uint64_t working_on = 0;
};

enum class LeaseKind : std::uint8_t { kWork = 0, kWait = 1, kDone = 2, kRefused = 3 };

/// collector -> one worker, keyed by worker, in the partition of its address.
struct Lease {
  std::string campaign;
  std::string worker;
  std::uint64_t request_id = 0;  ///< of the WorkRequest answered
  LeaseKind kind = LeaseKind::kWait;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;        ///< fencing token, not to be guessed: all but the newest of an index are refused
  std::uint64_t duration_ns = 0;  ///< the lease ends this long after the last heartbeat that named it
  std::string reason;             ///< for kRefused
  std::string campaign_id;
  std::string spec_sha256;    ///< that the work is of; a worker that is ready for another one makes itself ready first
  std::string sampling_json;  ///< the sampling weights that hold for `index` (ParseWeights); "": none
};

/// worker -> all, keyed by worker, twice a second: heartbeat of the lease it holds, and telemetry.
struct WorkerStatus {
  std::string campaign;
  std::string worker;
  std::string host;
  std::string phase;  ///< idle | plan | play | send | kGonePhase
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;     ///< not itself but its mark (campaign::MarkOf): others hear it; 0: holds no lease
  std::uint64_t episodes = 0;  ///< acknowledged since start
  std::uint64_t failures = 0;
  double steps_per_second = 0;
  double frames_per_second = 0;
  std::string campaign_id;
  std::string stage;         ///< of the attempt under way, as the expert or the rollout calls it; "": none
  std::uint32_t step = 0;    ///< control steps of the attempt that are done
  std::string last_outcome;  ///< of the last attempt: "success", or its typed reason; "": none yet
  /// Sums over all attempts since the start, where the time of attempts went (AttemptTimes), and what sending took.
  double plan_s = 0, step_s = 0, render_s = 0, deflate_s = 0, send_s = 0;
  std::vector<std::uint32_t> plan_histogram;  ///< attempts by their planning time: kPlanBins (PlanBin), or none yet
};

/// WorkerStatus::phase of the last heartbeat of a worker that goes home.
inline constexpr char kGonePhase[] = "gone";

/// Bins of WorkerStatus::plan_histogram: below 10, 20, 40 ... 10,240 ms, and longer.
inline constexpr std::size_t kPlanBins = 12;
constexpr std::size_t PlanBin(double plan_s) {
  std::size_t bin = 0;
  for (double edge = 0.01; bin + 1 < kPlanBins && plan_s >= edge; edge *= 2) ++bin;
  return bin;
}

/// worker -> collector: an attempt that produced no episode, and why. Answered by the next Lease.
struct AttemptReport {
  std::string campaign;
  std::string worker;
  std::uint64_t index = 0;
  std::uint32_t attempt = 0;
  std::uint64_t token = 0;
  std::string outcome;  ///< typed reason
  std::string details_json;
  std::string campaign_id;
  std::string spec_sha256;  ///< that was attempted
};

/// trainer -> collector, keyed by run, after each validation: where it errs, for a campaign with adaptive sampling.
struct ValidationErrors {
  std::string campaign;
  std::string run_id;
  std::uint64_t step = 0;   ///< of the training
  std::string errors_json;  ///< ErrorCellsText
  std::string campaign_id;
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
  std::string campaign_id;
  std::string state;            ///< running | draining | paused | stopping | complete
  std::string control_id;       ///< of the last CampaignControl that was taken
  std::string control_refusal;  ///< why it was not followed; "": it was
  /// Episodes that were made again on another host since the collector's start, and those of which that, in this or an
  /// earlier life, gave other bytes.
  std::uint64_t rechecked = 0, mismatched = 0;
};

enum class ControlAction : std::uint8_t { kPause = 0, kDrain = 1, kResume = 2, kStop = 3, kFilterKey = 4 };

/// `etude campaign`, `etude dataset filter` -> collector. Answered by a CampaignStatus with its control_id; said again,
/// it counts once.
struct CampaignControl {
  std::string campaign;
  std::string control_id;  ///< random, of this request
  std::string campaign_id;
  ControlAction action = ControlAction::kPause;
  std::string host, user;  ///< who asks, for the log
  std::string filter_key;  ///< kFilterKey: its name
  std::string episodes;    ///< kFilterKey: those that it shall have, "0-3,7"
};

// ---- blob.idl: large messages in chunks (services/bus/blob_transfer.h) ----------------------------

/// Announces one blob; everything needed to verify it.
struct BlobManifest {
  std::string channel;  ///< e.g. "episode", or a run's "latest"
  std::string sender;
  std::string owner;     ///< id of the campaign or run that it belongs to
  std::uint64_t id = 0;  ///< unique for (channel, sender)
  std::uint64_t size = 0;
  std::uint32_t chunk_size = 0;
  std::uint32_t chunk_count = 0;
  std::vector<std::uint8_t> sha256;  ///< 32 bytes
  std::uint64_t token = 0;           ///< fencing token of the lease; 0 if none
  std::string meta_json;
  std::vector<std::uint8_t> data;  ///< the whole blob when it fits into one chunk, else empty
  std::string host;                ///< Participant::address(): in whose partition the sender reads acknowledgements
};

struct BlobChunk {
  std::string channel;
  std::string sender;
  std::uint64_t id = 0;
  std::uint32_t index = 0;
  std::vector<std::uint8_t> data;  ///< <= 512 KiB
};

enum class AckKind : std::uint8_t { kProgress = 0, kDone = 1, kDuplicate = 2, kRefused = 3, kMissing = 4 };

/// receiver -> one sender, in the partition of its address.
struct BlobAck {
  std::string channel;
  std::string sender;  ///< whose blob
  std::uint64_t id = 0;
  AckKind kind = AckKind::kProgress;
  std::uint32_t received = 0;  ///< chunks received in order from 0 (opens the sender's window)
  std::vector<std::uint32_t> missing;
  std::string reason;  ///< for kRefused
  std::string owner;
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
  std::string run_id;
  std::string robot;               ///< a known robot's name or its file's; "": not said
  std::vector<double> intrinsics;  ///< of the picture, px: fx, fy, cx, cy; empty: not said
  /// Camera frame C in world W: p_WC (m), then q_WC as w, x, y, z; C as in services/episode/camera.h. Empty: not said.
  std::vector<double> camera_pose;
  std::string host;    ///< Participant::address(): in whose partition the client reads the action
  std::string server;  ///< Presence::instance of the policy server that is asked; "": whichever serves the run
};

/// Why an observation is not answered with waypoints. kFailed: what comes out is no number, and would be none again.
enum class Refusal : std::uint8_t { kNone = 0, kDoesNotFit = 1, kNotTrained = 2, kFailed = 3 };

/// policy server -> robot, keyed by session, in the partition of its address.
struct Action {
  std::string run;
  std::string session;
  std::uint64_t request_id = 0;
  std::string error;  ///< not empty: the observation was refused
  std::uint64_t checkpoint_step = 0;
  std::string checkpoint_sha256;
  std::vector<float> waypoints;  ///< kWaypoints * kWaypointSize, absolute, SI (episode/action.h)
  std::string modules_json;      ///< decoded output of every module, for people and for metrics
  std::string run_id;
  std::string rotation;  ///< how a waypoint says its rotation: a name of services/episode/action.h
  Refusal refusal = Refusal::kNone;
  float server_p50_ms = 0;  ///< of the server's last answers, from observation to action; 0: not measured yet
  float server_p99_ms = 0;
};

/// At most so many observations of a session are shown to a viewer: of those that come sooner it gets no insight.
inline constexpr int kInsightsPerSecond = 10;
/// s that viewers let a wish stand, and after which they say it again.
inline constexpr std::uint32_t kWishStands = 5, kWishAgain = 2;

/// viewer -> policy server: show me what the policy thinks of a session's observations. Said again before it ends.
struct InsightWish {
  std::string run;
  std::string viewer;  ///< one per viewer
  std::string run_id;
  std::string session;        ///< whose observations; "": anybody's
  std::uint32_t seconds = 0;  ///< for which it stands; 0: it is over
  std::string what_if_json;   ///< what to answer as well, see trainer/policy/what_if.h; "": nothing
};

/// policy server -> viewer, keyed by it. Never a robot's answer.
struct Insight {
  std::string run;
  std::string viewer;
  std::string run_id;
  std::string session;
  std::uint64_t request_id = 0;
  std::uint64_t checkpoint_step = 0;
  std::string checkpoint_sha256;
  std::string instruction;
  std::string error;           ///< not empty: nothing else is there
  std::string modules_json;    ///< as Action::modules_json
  std::string what_if_json;    ///< the same with the wish's what-if; "" without one
  std::string attention_json;  ///< layout of `attention`, see trainer/serve/insight.h
  std::vector<std::uint8_t> attention;
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint8_t> picture;     ///< RGB, height*width*3: the crop that the policy sees
  std::vector<float> waypoints;          ///< as Action::waypoints, rotations in 6D; empty: none, or not finite
  std::vector<std::uint32_t> view;       ///< u, v, width, height of `picture` in the camera's, px; empty: not said
  std::string worth_json;                ///< of words and joints, see trainer/serve/insight.h; "": not asked
  std::vector<float> what_if_waypoints;  ///< as `waypoints`, with the wish's what-if
};

/// policy server -> all, keyed by server, once a second: what it serves and how that goes.
struct PolicyStatus {
  std::string run;
  std::string server;  ///< unique: host-pid-random
  std::string run_id;
  std::string host;
  std::uint32_t pid = 0;
  std::string channel;     ///< that it follows: latest | best; "": one file
  std::uint64_t step = 0;  ///< of the checkpoint that it serves
  std::string sha256;      ///< of that checkpoint
  std::uint32_t stage = 0, stages = 0;
  std::string stage_name;
  bool control_trained = false;   ///< it may drive; else observations are refused
  std::uint64_t since = 0;        ///< when it began to serve it, seconds since 1970
  std::uint64_t answered = 0;     ///< observations, since its start, those that were refused too
  std::uint64_t refused = 0;      ///< checkpoints and observations
  std::string last_refusal;       ///< in words
  double p50_ms = 0, p95_ms = 0;  ///< of answers; before there are some: of its own trials
  std::uint32_t sessions = 0;     ///< that asked within the last 10 s
};

// ---- play.idl -------------------------------------------------------------------------------------

/// The DDS partition of PlayCommand and PlayState; a session's frames are in kPlayPartition/SESSION.
inline constexpr char kPlayPartition[] = "play";

enum class PlayAction : std::uint8_t {
  kScene = 0,  ///< {"index", "objects": [{"name", "x", "y", "yaw"}], "keep"}: set the scene, with objects where they
               ///< are put; with keep only these objects are moved, and all else is left as it is
  kSay = 1,    ///< {"sentence", "task", "target", "reference", "max_steps", "home"}: the policy drives
  kStop = 2,   ///< it stops driving; the scene stays as it is
  kNudge = 3,  ///< {"object", "dx", "dy"}: slides an object, m in the world
  kHide = 4,   ///< {"object"}: out of the picture
  kShow = 5,   ///< {"object"}: back to where it was hidden
  kReset = 6,  ///< the scene as it was set
  kClose = 7,  ///< ends the session
};

/// `etude play`, gateway -> worker in mode play, keyed by session. Said again until a PlayState names it; it counts
/// once.
struct PlayCommand {
  std::string session;
  std::string command_id;  ///< random, of this request
  PlayAction action = PlayAction::kScene;
  std::string arguments_json;  ///< see PlayAction; services/play/arguments.h
  std::string host, user;      ///< who asks, for the log
};

/// worker in mode play -> all, keyed by session, at most ten times a second.
struct PlayState {
  std::string session;
  std::string host;
  std::uint32_t pid = 0;
  std::string run;  ///< whose policy it asks: NAME or NAME@ID
  /// {"campaign", "tasks", "campaign_objects", "robot", "index", "seed", "camera", "objects", "table_half_m"}
  std::string scene_json;
  std::string phase;         ///< rest | moving | ended
  std::string command_id;    ///< of the command that was taken last
  std::string refusal;       ///< why it was not followed; "": it was
  std::string sentence;      ///< that is, or was last, obeyed; "": none yet
  std::string meaning_json;  ///< what the judge takes it to mean: {"task", "target", "reference"}; "": not judged
  std::uint32_t step = 0, max_steps = 0;  ///< control steps of this sentence
  std::string judge_json;                 ///< {"done", "held", "words", "success_latched", "violations", "disturbed"}
  std::string outcome;                    ///< of the sentence, once it ended: "success", "stopped", "timeout", ...
  std::string reason;                     ///< in words
  std::vector<float> joints;              ///< arm, then gripper; rad or m
  std::vector<float> waypoints;           ///< of the last answer, as Action::waypoints
  std::string modules_json;               ///< as Action::modules_json
  std::uint64_t checkpoint_step = 0;      ///< of the last answer
  double policy_ms = 0;                   ///< that the last answer took, as the worker waited for it
  double speed = 0;  ///< of simulated time against the clock's, since the last state; 1 is real time
  std::uint64_t attempts = 0, successes = 0;  ///< sentences that ended, and how many of them the judge took
};

/// worker in mode play -> who watches, keyed by session, at most ten times a second.
struct PlayFrame {
  std::string session;
  std::uint64_t number = 0;  ///< counts those of the session
  std::uint32_t step = 0;    ///< of PlayState
  std::uint32_t width = 0, height = 0;
  std::string format;               ///< "jpeg"
  std::vector<std::uint8_t> image;  ///< encoded
};

// ---- process.idl ----------------------------------------------------------------------------------

/// every process -> all, keyed by process, once a second.
struct ProcessStatus {
  std::string process;  ///< unique: host-pid-random
  std::string role;     ///< worker | collector | trainer | policy | gateway | etude up | ...
  std::string host;
  std::uint32_t pid = 0;
  std::string version;
  std::uint64_t since = 0;      ///< start, seconds since 1970
  std::uint64_t rss_bytes = 0;  ///< resident memory
  double cpu = 0;               ///< cores in use, mean over the last interval: 1 is one core
  std::string folder;           ///< that it writes to, if any; the disk is that of this folder, else of the working one
  std::uint64_t disk_free_bytes = 0, disk_total_bytes = 0;
  std::string participant;  ///< its DDS participant, 32 hexadecimal digits
  /// [{"topic", "kind": "writer" | "reader", "samples", "bytes", "matched"}]: since the start, by topic; bytes of the
  /// fields, without what DDS adds.
  std::string topics_json;
};

/// every process -> all, keyed by process: what it logged at warn and above.
struct ProcessEvent {
  std::string process, role, host;
  std::uint64_t number = 0;   ///< counts those of the process: a gap is what was dropped
  std::uint64_t time_ms = 0;  ///< since 1970
  std::string level;          ///< warn | error
  std::string code;           ///< CodeOf, services/core/log.h
  std::string text;
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
  std::string run_id;
};

}  // namespace etude::bus
