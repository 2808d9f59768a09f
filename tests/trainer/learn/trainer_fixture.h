// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <sstream>
#include <string>

#include "tests/trainer/learn/tiny_run.h"
#include "trainer/learn/trainer.h"

namespace etude::learn {
namespace trainer_test {

/// Values of `key` in lines of `kind`, by step
inline std::map<std::uint64_t, double> Curve(const Path& run, const std::string& kind, const std::string& key) {
  std::map<std::uint64_t, double> curve;
  const auto text = ReadTextFile(run / "metrics.jsonl");
  EXPECT_TRUE(text);
  std::istringstream lines(text.value_or(""));
  for (std::string line; std::getline(lines, line);) {
    const auto json = OrderedJson::parse(line);
    if (json["kind"] == kind && json.contains(key)) curve[json["step"]] = json[key];
  }
  return curve;
}

/// Trains tiny policies on a tiny dataset, "d".
class TrainerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    dataset_ = TinyDataset(folder_ / "d", 24);
  }
  Status Train(const TrainConfig& config, const Path& out, bool resume = false, const Hooks& hooks = {}) {
    auto trainer = Trainer::Create(config, dataset_, {.out = out, .resume = resume}, hooks);
    if (!trainer) return Fail(trainer.error());
    return (*trainer)->Run();
  }

  TemporaryFolder folder_;
  std::shared_ptr<data::Dataset> dataset_;
};

}  // namespace trainer_test
}  // namespace etude::learn
