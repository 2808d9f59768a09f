// SPDX-License-Identifier: Apache-2.0
// Commands that somebody with the token started: children of the gateway, each with its log.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "services/campaign/process.h"
#include "services/core/config.h"
#include "services/core/thread_annotations.h"

namespace etude::api {

/// How many of it may run at once: heavy ones one, light and heavy ones four together, lasting ones (servers, play
/// sessions) eight of their own, brief ones (words to a collector) any number.
enum class Weight : std::uint8_t { kBrief, kLight, kHeavy, kLasting };

/// Thread-safe, but its thread-bound children need Start, Poll and the end on one thread that lives as long as the
/// gateway: see Pump.
class Jobs {
 public:
  /// @param folder  for the logs: one goes with its job, and those of gateways that ended go here when they are a day
  /// old
  /// @param program  what is started: one that lies beside this one, or an absolute path
  explicit Jobs(Path folder, std::string program = "etude");

  struct Request {
    std::string action;
    std::vector<std::string> arguments;  ///< behind the program, never through a shell
    Weight weight = Weight::kLight;
    std::string once = {};  ///< while one with the same word runs, no second one does; "": any number
    /// Called by Pump at its end, also where it could not be started; shall be quick. @param well  exit code 0
    std::function<void(bool well)> finish = nullptr;
  };
  /// Waits for the next Pump. @returns its id, or that of the one that runs (`once`), and then never calls finish.
  /// @error kUnavailable: as many as may are at work (Weight)
  Result<std::string> Add(const Request& request);
  /// The one that runs. nullopt: none
  std::optional<std::string> Running(const std::string& once) const;
  /// Whether one runs, or waits to.
  bool Busy() const;
  /// Starts what waits and looks after what runs. Call a few times a second, always on the same thread: the kernel ends
  /// children with the thread that started them.
  void Pump();
  /// Asks it to end (SIGTERM); asked again, it ends at once. @error kNotFound
  Status Stop(const std::string& id);
  /// Ends all children; on the thread of Pump.
  void StopAll();

  Result<OrderedJson> Json(const std::string& id) const;  ///< Job of openapi.json. @error kNotFound
  OrderedJson All() const;                                ///< newest first

 private:
  struct Job {
    std::string id, action, command;
    std::vector<std::string> arguments;
    Weight weight = Weight::kLight;
    std::string once;
    std::function<void(bool)> finish;
    double started = 0, ended = 0;
    std::optional<int> exit_code;
    std::optional<campaign::Process> process;
    int stops = 0, told = 0;  // asked for, and of these said to the process
    double log_used = 0;      // when its log was last said to be in use
    std::string problem;      // why it could not be started
    bool running() const { return ended == 0; }
  };
  const Job* Same(const std::string& once) const ETUDE_REQUIRES(mutex_);  // the one that runs
  void ForgetOldest() ETUDE_REQUIRES(mutex_);
  void StartJob(Job& job) ETUDE_REQUIRES(mutex_);
  static void End(Job& job, int exit_code);
  OrderedJson JsonOf(const Job& job) const;
  Path LogOf(const Job& job) const { return folder_ / (job.id + ".log"); }
  void CutLog(const Job& job) const;
  void KeepLog(Job& job) const;

  const Path folder_;
  const std::string program_;
  mutable Mutex mutex_;
  std::deque<Job> jobs_ ETUDE_GUARDED_BY(mutex_);  // newest first
};

/// For a shell: quoted where it has to be.
std::string CommandText(const std::vector<std::string>& arguments);

}  // namespace etude::api
