// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/report.h"

#include <fmt/format.h>

#include "services/core/log.h"
#include "trainer/learn/keep.h"

namespace etude::learn {
namespace {

constexpr double kProgressEvery = 1;  // s
constexpr double kLineEvery = 10;     // s

}  // namespace

bool Reporter::due() const { return since_progress_.Seconds() >= kProgressEvery; }

void Reporter::Add(const BatchLoss& loss, double wait_s, const Optimizer::Outcome& outcome) {
  window_.loss += loss.total;
  window_.wait_s += wait_s;
  window_.gradient_norm += outcome.gradient_norm;
  for (const auto& [name, value] : loss.terms) window_.terms[name] += value;
  for (const auto& [part, norm] : outcome.part_norms) window_.terms[part + ".gradient"] += norm;
  ++window_.steps;
}

void Reporter::TakeRates() {
  if (window_.steps == 0) return;
  const double seconds = window_.watch.Seconds();
  last_.loss = window_.loss / window_.steps;
  last_.data_wait = window_.wait_s / seconds;
  last_.samples_per_second = window_.steps * run_.config.data.batch / seconds;
}

Status Reporter::Flush() {
  if (window_.steps == 0) return {};
  TakeRates();
  const double n = window_.steps;
  std::map<std::string, double> scalars{
      {"loss", last_.loss},
      {"gradient_norm", window_.gradient_norm / n},
      {"learning_rate", LearningRate(run_.config.optimizer, run_.step, run_.Progress())},
      {"samples_per_second", last_.samples_per_second},
      {"data_wait", last_.data_wait},
      {"episodes", static_cast<double>(run_.dataset->snapshot()->episode_count(data::Split::kTrain))},
      {"stage", run_.scheduler->stage()}};
  for (const auto& [name, value] : window_.terms) scalars[name] = value / n;
  window_ = {};
  return WriteOrWait(run_, "metrics.jsonl",
                     [&] { return run_.log->Write("train", run_.step, run_.Elapsed(), scalars); });
}

void Reporter::Report(bool finished) {
  last_.step = run_.step;
  last_.stage = run_.scheduler->stage();
  last_.stages = run_.scheduler->stages();
  last_.stage_name = run_.scheduler->StageName();
  last_.progress = run_.Progress();
  last_.train_episodes = run_.dataset->snapshot()->episode_count(data::Split::kTrain);
  last_.eta_s = last_.progress > 0 ? run_.Elapsed() * (1 - last_.progress) / last_.progress : 0;
  last_.checkpoint_step = run_.checkpoint_step;
  last_.metrics = run_.evaluation.metrics;
  last_.finished = finished;
  TakeRates();
  if (hooks_.on_progress) hooks_.on_progress(last_);
  since_progress_.Restart();
  if (!finished && display_.in_place()) return display_.Show(Line());
  if (!finished && since_line_.Seconds() < kLineEvery) return;
  since_line_.Restart();
  Log().info("{}", Line());
}

std::string Reporter::Line() const {
  std::string metrics;
  for (const auto& [name, value] : last_.metrics)
    if (!name.ends_with(".hit") && !name.ends_with("_cm") && name != "loss")
      metrics += fmt::format(" {}={:.3g}", name, value);
  return fmt::format("step {} stage {}/{} {} loss {:.4g} {:.0f} samples/s wait {:.1f} % episodes {} eta {}{}",
                     last_.step, last_.stage, last_.stages, last_.stage_name, last_.loss, last_.samples_per_second,
                     100 * last_.data_wait, last_.train_episodes, FormatDuration(last_.eta_s), metrics);
}

}  // namespace etude::learn
