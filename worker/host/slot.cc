// SPDX-License-Identifier: Apache-2.0
#include "worker/host/slot.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "services/spec/attempt_outcome.h"
#include "worker/host/messages.h"

namespace etude::host {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMostWords = 2000;
constexpr int kMostReads = 64;  // at once: a child that never stops talking does not keep its host
constexpr auto kLook = 50ms;
constexpr auto kStoodStill = 5s;  // between two looks: this process, or its machine, was stopped
constexpr auto kStopPatience = 500ms;

// How far a child says it is. What is no such thing is no progress.
std::optional<std::pair<std::string, std::uint32_t>> ProgressOf(const OrderedJson& head) {
  if (!head.contains("step") || !head["step"].is_number_unsigned()) return std::nullopt;
  if (!head.contains("stage") || !head["stage"].is_string()) return std::nullopt;
  return std::pair(head["stage"].get<std::string>(), head["step"].get<std::uint32_t>());
}

}  // namespace

Slot::Slot(SlotOptions options) : options_(std::move(options)) {}
Slot::~Slot() { Forget(); }

std::optional<pid_t> Slot::pid() const { return process_ ? std::optional(process_->pid()) : std::nullopt; }

void Slot::Forget() {
  channel_.reset();  // a child whose host has gone ends by itself
  if (process_) process_->Stop(std::chrono::duration_cast<std::chrono::milliseconds>(kStopPatience));
  process_.reset();
  words_.reset();
}

Status Slot::Start() {
  Forget();
  last_words_.clear();
  ETUDE_ASSIGN_OR_RETURN(const auto ends, MakeSocketPair());
  channel_.emplace(ends[0]);
  const Channel childs(ends[1]);  // closed here once it has its own
  channel_->LimitSend(options_.stall);
  int words[2];
  if (::pipe2(words, O_CLOEXEC | O_NONBLOCK) != 0) return Fail(ErrnoError("make", "a pipe for a child", errno));
  words_.reset(words[0]);
  const Descriptor childs_words(words[1]);
  auto started =
      campaign::Process::Start({.argv = options_.argv, .socket = childs.descriptor(), .output = childs_words.get()});
  if (!started) return Fail(started.error());
  process_.emplace(std::move(*started));
  return {};
}

// The host's log has what its children say; their last words are kept for the report of their end.
void Slot::ReadWords() {
  char text[4096];
  for (int reads = 0; reads < kMostReads && words_; ++reads) {
    const ssize_t got = ::read(words_.get(), text, sizeof text);
    if (got <= 0) return;
    const auto size = static_cast<std::size_t>(got);
    [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, text, size);
    last_words_.append(text, size);
    if (last_words_.size() > kMostWords) last_words_.erase(0, last_words_.size() - kMostWords);
  }
}

// Ends the child that is no use any more; `why` where it did not end by itself.
Slot::Loss Slot::End(const char* reason, const std::string& why) {
  // what crashed closes its socket a moment before it has ended
  auto exit_code = process_->Wait(reason == std::string_view(kChildHung) ? 0ms : 1000ms);
  const bool by_itself = exit_code.has_value();
  if (!by_itself) {
    process_->Signal(SIGKILL);
    exit_code = process_->Wait(5s);
  }
  ReadWords();
  Loss loss{by_itself ? kChildCrashed : reason, by_itself ? campaign::HowItEnded(*exit_code) : why,
            by_itself ? campaign::Crashed(*exit_code) : reason == std::string_view(kChildHung)};
  process_.reset();
  Forget();
  return loss;
}

// Until a frame of the wanted kind, or a failure, is in `answer`; or the child is lost.
std::optional<Slot::Loss> Slot::Await(FrameKind wanted, const campaign::WorkItem* item, const policy::AskFunction& ask,
                                      Result<Frame>& answer) {
  auto moved = MonotonicClock::now(), looked = moved;
  std::optional<std::pair<std::string, std::uint32_t>> reached;
  bool spoke = false;  // since it moved
  // a campaign may be more patient than a host. Nine tenths, so that the host's word, which says why, comes before the
  // collector takes the lease
  const auto patience = std::chrono::milliseconds(static_cast<std::int64_t>(900 * joined_->spec.stall_timeout_s));
  const auto stall = std::max(options_.stall, patience);
  const auto hung = [&]() -> std::optional<Loss> {
    if (MonotonicClock::now() - moved < stall) return std::nullopt;
    return End(kChildHung, fmt::format("SIGKILL after {:g} s without {}", static_cast<double>(stall.count()) / 1000,
                                       spoke ? "progress" : "a word"));
  };
  while (true) {
    if (!item && joined_->moved) joined_->moved();  // an attempt says for itself that it goes on
    if (StopRequested()) {
      Forget();
      answer = Fail(Code::kTimeout, "this process was asked to stop");
      return std::nullopt;
    }
    auto frame = channel_->Receive(std::chrono::duration_cast<std::chrono::milliseconds>(kLook));
    ReadWords();
    // a host that was stopped, with its child or without: that time says nothing of the child
    const auto now = MonotonicClock::now(), before = std::exchange(looked, now);
    if (now - before > kStoodStill) moved += now - before;
    if (!frame) return End(kChildCrashed, frame.error().message);
    if (!*frame) {
      if (auto loss = hung()) return loss;
      continue;
    }
    if ((*frame)->kind == FrameKind::kQuestion && item && ask) {
      if (const Status replied = Reply(**frame, ask); !replied) return End(kChildCrashed, replied.error().message);
    } else if ((*frame)->kind == FrameKind::kProgress && item) {
      // one that says the same again and again lives, and does not move
      auto said = ProgressOf((*frame)->head);
      if (!said || said == reached) {
        spoke = true;
        if (auto loss = hung()) return loss;
        continue;
      }
      reached = std::move(said);
      if (item->progress) item->progress(reached->first, reached->second);
    } else if ((*frame)->kind == wanted || (*frame)->kind == FrameKind::kFailure) {
      answer = std::move(**frame);
      return std::nullopt;
    } else {
      return End(kChildCrashed,
                 fmt::format("it said something out of turn (frame kind {})", static_cast<int>((*frame)->kind)));
    }
    moved = looked = MonotonicClock::now();  // after an answer of the policy's, however long it took
    spoke = false;
  }
}

Status Slot::Reply(const Frame& frame, const policy::AskFunction& ask) {
  ETUDE_ASSIGN_OR_RETURN(const policy::Question question, QuestionOf(frame));
  const auto answer = ask(question);
  if (!answer) return channel_->Send(FrameKind::kFailure, ErrorHead(answer.error()));
  return channel_->Send(FrameKind::kAnswer, AnswerHead(*answer));
}

Status Slot::CountDeath(const Loss& loss) {
  const int deaths = ++*options_.deaths;
  Log().warn("a child is lost and replaced slot={} reason={} ended_by='{}'", options_.name, loss.reason, loss.ended_by);
  if (deaths < options_.hopeless) return {};
  return Fail(
      Code::kUnavailable,
      fmt::format("{} children died without one result meanwhile; the last one ended by {}. Its last words:\n{}",
                  deaths, loss.ended_by, last_words_));
}

Status Slot::Begin(const campaign::JoinedCampaign& joined) {
  joined_ = joined;
  while (true) {
    if (!process_) {
      if (const Status started = Start(); !started) {  // no memory, no process, no descriptor: it may pass
        Forget();
        if (started.error().code != Code::kUnavailable) return started;
        ETUDE_RETURN_IF_ERROR(CountDeath({kChildCrashed, started.error().message}));
        if (WaitForStop(2s)) return {};
        continue;
      }
    }
    Result<Frame> answer = Fail(Code::kInternal, "");
    const Status sent = channel_->Send(FrameKind::kCampaign, CampaignHead(*joined_));
    const auto loss =
        sent ? Await(FrameKind::kReady, nullptr, {}, answer) : std::optional(End(kChildCrashed, sent.error().message));
    if (loss) {
      ETUDE_RETURN_IF_ERROR(CountDeath(*loss));
      if (WaitForStop(200ms)) return {};
      continue;
    }
    if (!answer) return StopRequested() ? Status() : Status(Fail(answer.error()));
    if (answer->kind == FrameKind::kFailure) return Fail(ErrorOf(answer->head));
    return {};
  }
}

Result<campaign::WorkResult> Slot::Release(const Loss& loss) {
  ETUDE_RETURN_IF_ERROR(CountDeath(loss));
  campaign::WorkResult result{.outcome = kReleased};
  result.details_json = JsonText(OrderedJson{{"reason", loss.reason},
                                             {kByAttempt, loss.by_attempt},
                                             {"ended_by", loss.ended_by},
                                             {"last_words", last_words_}});
  return result;
}

Result<campaign::WorkResult> Slot::Do(const campaign::WorkItem& item, const policy::AskFunction& ask) {
  if (!process_) ETUDE_RETURN_IF_ERROR(Begin(*joined_));
  if (!process_) return campaign::WorkResult{.outcome = kReleased};  // a stop
  Result<Frame> answer = Fail(Code::kInternal, "");
  const Status sent = channel_->Send(FrameKind::kWork, WorkHead(item));
  auto loss =
      sent ? Await(FrameKind::kResult, &item, ask, answer) : std::optional(End(kChildCrashed, sent.error().message));
  if (loss) return Release(*loss);
  if (!answer) return campaign::WorkResult{.outcome = kReleased};  // a stop
  if (answer->kind == FrameKind::kFailure) return Fail(ErrorOf(answer->head));
  auto result = ResultOf(std::move(*answer));
  if (!result) return Release(End(kChildCrashed, result.error().message));
  *options_.deaths = 0;
  return result;
}

}  // namespace etude::host
