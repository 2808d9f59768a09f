// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/jobs.h"

#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <initializer_list>

#include "dashboard/server/sources/bounded_folder.h"
#include "dashboard/server/sources/files.h"
#include "services/core/clock.h"
#include "services/core/identity.h"
#include "services/core/log.h"

namespace etude::api {
namespace {

constexpr std::size_t kAtOnce = 4, kLasting = 8, kKept = 50, kLogLines = 200;
constexpr std::streamoff kLogTail = 64 * 1024;
constexpr std::uintmax_t kMostLogBytes = 4 << 20;
constexpr std::chrono::seconds kPatience{5};

std::vector<std::string> Tail(const Path& log) {
  std::vector<std::string> lines;
  std::ifstream stream(log, std::ios::binary | std::ios::ate);
  if (!stream) return lines;
  const auto size = static_cast<std::streamoff>(stream.tellg());
  stream.seekg(std::max<std::streamoff>(0, size - kLogTail));
  for (std::string line; std::getline(stream, line);) {
    if (const auto over = line.rfind('\r'); over != std::string::npos) line.erase(0, over + 1);
    if (!line.empty()) lines.push_back(line.substr(0, 2000));
  }
  if (lines.size() > kLogLines) lines.erase(lines.begin(), lines.end() - kLogLines);
  return lines;
}

// Others' too, who may be at work: theirs are newer.
void RemoveOldLogs(const Path& folder) {
  constexpr double kOld_s = 24 * 3600;
  std::error_code error;
  std::vector<Path> old;
  for (std::filesystem::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (it->path().extension() == ".log" && WallSeconds() - sources::StampOf(it->path()).modified_s() > kOld_s)
      old.push_back(it->path());
  for (const auto& log : old) std::filesystem::remove(log, error);
}

}  // namespace

Jobs::Jobs(Path folder, std::string program) : folder_(std::move(folder)), program_(std::move(program)) {
  RemoveOldLogs(folder_);
}

std::string CommandText(const std::vector<std::string>& arguments) {
  std::string text;
  for (const auto& argument : arguments) {
    const bool plain = !argument.empty() && std::ranges::all_of(argument, [](unsigned char c) {
      return std::isalnum(c) || std::string_view("_-./=@:,+").find(static_cast<char>(c)) != std::string_view::npos;
    });
    if (!text.empty()) text += ' ';
    if (plain) {
      text += argument;
      continue;
    }
    text += '\'';
    for (const char c : argument) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
    text += '\'';
  }
  return text;
}

Result<std::string> Jobs::Add(const Request& request) {
  MutexLock lock(mutex_);
  if (const Job* same = Same(request.once)) return same->id;
  const auto running = [&](std::initializer_list<Weight> weights) {
    return static_cast<std::size_t>(std::ranges::count_if(jobs_, [&](const Job& job) {
      return job.running() && std::ranges::find(weights, job.weight) != weights.end();
    }));
  };
  const bool lasting = request.weight == Weight::kLasting;
  const std::size_t most = lasting ? kLasting : kAtOnce;
  const std::size_t there = lasting ? running({Weight::kLasting}) : running({Weight::kLight, Weight::kHeavy});
  if (request.weight != Weight::kBrief && there >= most)
    return Fail(Code::kUnavailable, fmt::format("{} jobs are at work; {} (page Fleet, Jobs)", most,
                                                lasting ? "stop one" : "wait for one to end, or stop it"));
  if (request.weight == Weight::kHeavy && running({Weight::kHeavy}) > 0)
    return Fail(Code::kUnavailable, "a job of this kind is at work: one at a time; wait for it to end, or stop it");
  Job job;
  job.id = NewId();
  job.action = request.action;
  job.arguments = request.arguments;
  job.weight = request.weight;
  job.once = request.once;
  job.finish = request.finish;
  job.started = WallSeconds();
  std::vector<std::string> words{"etude"};
  words.insert(words.end(), request.arguments.begin(), request.arguments.end());
  job.command = CommandText(words);
  jobs_.push_front(std::move(job));
  ForgetOldest();
  return jobs_.front().id;
}

// Those that have ended: one that lasts (a policy server) keeps the younger ones from nothing.
void Jobs::ForgetOldest() {
  for (auto job = jobs_.end(); jobs_.size() > kKept && job != jobs_.begin();) {
    --job;
    if (job->running()) continue;
    std::error_code ignored;
    std::filesystem::remove(LogOf(*job), ignored);
    job = jobs_.erase(job);
  }
}

void Jobs::StartJob(Job& job) {
  const auto program = campaign::FindSibling(program_);
  if (program) {
    std::vector<std::string> argv{program->string()};
    argv.insert(argv.end(), job.arguments.begin(), job.arguments.end());
    auto process = campaign::Process::Start({argv, LogOf(job), {}});
    if (process) {
      job.process.emplace(std::move(*process));
      Log().info("job={} pid={}: {}", job.id, job.process->pid(), job.command);
      return;
    }
    job.problem = process.error().message;
  } else {
    job.problem = program.error().message;
  }
  End(job, 1);
}

void Jobs::End(Job& job, int exit_code) {
  job.process.reset();
  if (job.finish) job.finish(exit_code == 0);
  job.exit_code = exit_code;
  job.ended = WallSeconds();
  if (exit_code != 0) Log().warn("job={} ended with {}: {}", job.id, exit_code, job.command);
}

void Jobs::Pump() {
  MutexLock lock(mutex_);
  for (auto& job : jobs_) {
    if (!job.running()) continue;
    if (!job.process) {
      StartJob(job);
      continue;
    }
    for (; job.told < job.stops; ++job.told)
      job.process->Signal(SIGTERM);  // programs of ours end at once at the second
    CutLog(job);
    KeepLog(job);
    if (const auto exit_code = job.process->Poll()) End(job, *exit_code);
  }
}

// To its end, which is what is shown: a server's log grows for weeks. Its child appends, and goes on behind that.
void Jobs::CutLog(const Job& job) const {
  const Path log = LogOf(job);
  std::error_code error;
  const auto size = std::filesystem::file_size(log, error);
  if (error || size <= kMostLogBytes) return;
  std::string text;
  for (const auto& line : Tail(log)) text += line + "\n";
  std::ofstream(log, std::ios::binary | std::ios::trunc) << text;
}

// A job that says nothing for a day is at work: another gateway that starts here must see it (RemoveOldLogs).
void Jobs::KeepLog(Job& job) const {
  constexpr double kEach_s = 3600;
  const double now = WallSeconds();
  if (now - job.log_used < kEach_s) return;
  job.log_used = now;
  sources::MarkUsed(LogOf(job));
}

const Jobs::Job* Jobs::Same(const std::string& once) const {
  const auto found =
      std::ranges::find_if(jobs_, [&](const Job& job) { return job.running() && !once.empty() && job.once == once; });
  return found == jobs_.end() ? nullptr : &*found;
}

std::optional<std::string> Jobs::Running(const std::string& once) const {
  MutexLock lock(mutex_);
  const Job* same = Same(once);
  return same ? std::optional(same->id) : std::nullopt;
}

bool Jobs::Busy() const {
  MutexLock lock(mutex_);
  return std::ranges::any_of(jobs_, &Job::running);
}

Status Jobs::Stop(const std::string& id) {
  MutexLock lock(mutex_);
  const auto job = std::ranges::find(jobs_, id, &Job::id);
  if (job == jobs_.end()) return Fail(Code::kNotFound, fmt::format("there is no job '{:.40}'", id));
  job->stops += job->running();
  return {};
}

void Jobs::StopAll() {
  MutexLock lock(mutex_);
  for (auto& job : jobs_)
    if (job.process) job.process->Terminate();
  for (auto& job : jobs_)
    if (job.process) job.process->Stop(kPatience);
}

OrderedJson Jobs::JsonOf(const Job& job) const {
  auto log = Tail(LogOf(job));
  if (!job.problem.empty()) log.push_back(job.problem);
  const char* state = job.running() ? "running" : job.exit_code == 0 ? "done" : "failed";
  return {{"id", job.id},
          {"action", job.action},
          {"command", job.command},
          {"state", state},
          {"stopping", job.stops > 0},
          {"progress", nullptr},
          {"started", sources::Rfc3339(job.started)},
          {"ended", sources::TimeJson(job.ended)},
          {"exit_code", job.exit_code ? OrderedJson(*job.exit_code) : OrderedJson()},
          {"log", log},
          {"result", nullptr}};
}

Result<OrderedJson> Jobs::Json(const std::string& id) const {
  MutexLock lock(mutex_);
  const auto job = std::ranges::find(jobs_, id, &Job::id);
  if (job == jobs_.end()) return Fail(Code::kNotFound, fmt::format("there is no job '{:.40}'", id));
  return JsonOf(*job);
}

OrderedJson Jobs::All() const {
  MutexLock lock(mutex_);
  OrderedJson all = OrderedJson::array();
  for (const auto& job : jobs_) all.push_back(JsonOf(job));
  return all;
}

}  // namespace etude::api
