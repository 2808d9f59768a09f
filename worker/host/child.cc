// SPDX-License-Identifier: Apache-2.0
#include "worker/host/child.h"

#include <fmt/format.h>

#include <optional>
#include <string>

#include "services/core/clock.h"
#include "services/core/stop.h"
#include "services/spec/task_files.h"
#include "services/spec/task_name.h"
#include "worker/host/messages.h"

namespace etude::host {
namespace {

using namespace std::chrono_literals;

constexpr double kProgressEvery = 0.1;  // s; a stage that changes is told at once

class Child {
 public:
  Child(Channel channel, const ChildFactory& factory) : channel_(std::move(channel)), factory_(factory) {}

  Status Serve() {
    while (!StopRequested()) {
      const auto frame = channel_.Receive(500ms);
      if (!frame && frame.error().code == Code::kUnavailable) return {};  // the host has gone
      if (!frame) return Fail(frame.error());
      if (!*frame) continue;
      ETUDE_RETURN_IF_ERROR(Follow(**frame));
    }
    return {};
  }

 private:
  Status Follow(const Frame& frame) {
    if (frame.kind == FrameKind::kCampaign) return Prepare(frame);
    if (frame.kind == FrameKind::kWork && work_) return Work(frame);
    return Fail(Code::kCorrupt,
                fmt::format("a host sent a frame of kind {} that means nothing here", static_cast<int>(frame.kind)));
  }

  Status Prepare(const Frame& frame) {
    ETUDE_ASSIGN_OR_RETURN(const auto joined, CampaignOf(frame.head));
    work_ = nullptr;  // the old one's context goes first
    spec_ = joined.spec;
    ForgetTaskFiles();
    if (const Status same = CheckTaskFiles(joined); !same)
      return channel_.Send(FrameKind::kFailure, ErrorHead(same.error()));
    auto made = factory_(joined, [this](const policy::Question& question) { return Ask(question); });
    if (!made) return channel_.Send(FrameKind::kFailure, ErrorHead(made.error()));
    work_ = std::move(*made);
    return channel_.Send(FrameKind::kReady, OrderedJson::object());
  }

  // They may have been written between the host's look at them and this one's: a child may be started at any time.
  static Status CheckTaskFiles(const campaign::JoinedCampaign& joined) {
    if (joined.spec_sha256.empty() || SpecHash(joined.spec) == joined.spec_sha256) return {};
    return Fail(Code::kUnavailable, fmt::format("go on with campaign '{}@{}': {}; put back what was there",
                                                joined.spec.name, joined.id, WhyHashDiffers(joined.spec)));
  }

  Status Work(const Frame& frame) {
    ETUDE_ASSIGN_OR_RETURN(auto item, WorkOf(frame.head, spec_));
    Stopwatch since_told;
    std::string told;
    item.progress = [&](std::string_view stage, std::uint32_t step) {
      if (stage == told && since_told.Seconds() < kProgressEvery) return;
      told = stage;
      since_told.Restart();
      // a host that has gone is noticed with the result
      (void)channel_.Send(FrameKind::kProgress, {{"stage", told}, {"step", step}});
    };
    const auto result = work_(item);
    if (!result) return channel_.Send(FrameKind::kFailure, ErrorHead(result.error()));
    return channel_.Send(FrameKind::kResult, ResultHead(*result), result->episode);
  }

  Result<policy::Answer> Ask(const policy::Question& question) {
    ETUDE_RETURN_IF_ERROR(channel_.Send(FrameKind::kQuestion, QuestionHead(question), question.rgb));
    while (!StopRequested()) {
      ETUDE_ASSIGN_OR_RETURN(const auto frame, channel_.Receive(500ms));
      if (!frame) continue;
      if (frame->kind == FrameKind::kAnswer) return AnswerOf(frame->head);
      if (frame->kind == FrameKind::kFailure) return Fail(ErrorOf(frame->head));
      return Fail(Code::kCorrupt, "a host sent something else than the answer to a question");
    }
    return Fail(Code::kTimeout, "ask the policy: this process was asked to stop");
  }

  Channel channel_;
  const ChildFactory& factory_;
  CampaignSpec spec_;
  campaign::WorkFunction work_;
};

}  // namespace

Status ServeHost(Channel channel, const ChildFactory& factory) { return Child(std::move(channel), factory).Serve(); }

}  // namespace etude::host
