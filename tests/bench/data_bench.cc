// SPDX-License-Identifier: Apache-2.0
// How long a training step waits for data: preset compact on a dataset on disk, with the cache of
// decoded crops (as shipped) and without it (every picture is read and inflated every time, with its block).
//   data_bench [steps]
#include <fmt/format.h>

#include <cstdlib>
#include <vector>

#include "services/core/clock.h"
#include "services/core/statistics.h"
#include "services/store/dataset.h"
#include "tests/support/synthetic_episode.h"
#include "tests/support/temporary_folder.h"
#include "trainer/data/loader.h"
#include "trainer/data/statistics.h"
#include "trainer/learn/optimizer.h"
#include "trainer/learn/replicas.h"
#include "trainer/learn/tensors.h"
#include "trainer/policy/crop.h"
#include "trainer/policy/names.h"
#include "trainer/policy/torch_process.h"

namespace etude {
namespace {

constexpr std::uint64_t kEpisodes = 30;
constexpr int kSteps = 60;  // control steps an episode

struct Rates {
  double wait = 0, samples_per_second = 0;
};

class Bench {
 public:
  Status Open(const Path& folder) {
    ETUDE_ASSIGN_OR_RETURN(config_, learn::LoadTrainConfig("compact", "trainer/experiments",
                                                           {"steps=1", "policy.image.crop=[41,75,144,80]",
                                                            "policy.tasks=[pick, push, put_down]"}));
    const CampaignSpec spec = SyntheticSpec(224, 224);
    ETUDE_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Open(folder, spec));
    for (std::uint64_t i = 0; i < kEpisodes; ++i)
      ETUDE_RETURN_IF_ERROR(writer.Commit(MakeSyntheticEpisode(spec, i, kSteps)));
    ETUDE_ASSIGN_OR_RETURN(dataset_, data::Dataset::Open(folder));
    ETUDE_ASSIGN_OR_RETURN([[maybe_unused]] const int added, dataset_->Refresh());
    ETUDE_ASSIGN_OR_RETURN(const auto statistics, data::ComputeStatistics(*dataset_->snapshot()));
    ETUDE_ASSIGN_OR_RETURN(auto grammar, language::Grammar::Load());
    grammar_ = std::make_shared<const language::Grammar>(std::move(grammar));
    std::vector<std::shared_ptr<policy::Policy>> policies;
    for (unsigned r = 0; r < std::max(1u, std::thread::hardware_concurrency()); ++r) {
      ETUDE_ASSIGN_OR_RETURN(auto policy,
                             policy::Policy::Create(config_.policy, learn::ToNormalization(statistics), config_.seed));
      policy->train();
      policies.push_back(std::move(policy));
    }
    optimizer_ = std::make_unique<learn::Optimizer>(config_.optimizer, policies);
    replicas_ = std::make_unique<learn::Replicas>(std::move(policies));
    return {};
  }

  Result<Rates> Run(int cache_mb, int steps) {
    data::DataConfig data = config_.data;
    data.cache_mb = cache_mb;
    auto maker = std::make_shared<const data::BatchMaker>(
        data,
        data::BatchContent{policy::CropOf(config_.policy.image), 224, 224, dataset_->spec().tasks,
                           config_.policy.objects, policy::LabelColumnsOf(config_.policy), config_.policy.tasks},
        grammar_);
    data::Loader loader(dataset_, maker, data, config_.seed, 0);
    double waited = 0;
    Stopwatch whole;
    for (int step = -kWarmUp; step < steps; ++step) {
      if (step == 0) {
        waited = 0;
        whole.Restart();
      }
      Stopwatch wait;
      ETUDE_ASSIGN_OR_RETURN(auto batch, loader.Next());
      waited += wait.Seconds();
      optimizer_->ZeroGradients();
      ETUDE_ASSIGN_OR_RETURN([[maybe_unused]] const auto loss, replicas_->Backward(*batch, 0));
      optimizer_->Step(1e-3);
      loader.Recycle(std::move(batch));
    }
    return Rates{waited / whole.Seconds(), steps * data.batch / whole.Seconds()};
  }

  const learn::TrainConfig& config() const { return config_; }

 private:
  static constexpr int kWarmUp = 10;  // the first steps also allocate

  learn::TrainConfig config_;
  std::shared_ptr<data::Dataset> dataset_;
  std::shared_ptr<const language::Grammar> grammar_;
  std::unique_ptr<learn::Optimizer> optimizer_;
  std::unique_ptr<learn::Replicas> replicas_;
};

Status Main(int steps) {
  const TemporaryFolder folder;
  policy::SetTorchThreads(1);
  learn::SetBlasThreads(1);
  Bench bench;
  ETUDE_RETURN_IF_ERROR(bench.Open(folder / "dataset"));
  std::vector<double> cached, uncached, rate;
  for (int round = 0; round < 3; ++round) {
    ETUDE_ASSIGN_OR_RETURN(const Rates with, bench.Run(bench.config().data.cache_mb, steps));
    ETUDE_ASSIGN_OR_RETURN(const Rates without, bench.Run(0, steps));
    cached.push_back(with.wait);
    uncached.push_back(without.wait);
    rate.push_back(with.samples_per_second);
  }
  constexpr double kLimit = 0.05;
  const double value = Quantile(cached, 0.5);
  fmt::print(
      "{{\"name\": \"data_wait\", \"value\": {:.5f}, \"unit\": \"fraction\", \"baseline\": {}, "
      "\"ratio\": {:.3f}, "
      "\"without_cache\": {:.5f}, \"samples_per_second\": {:.0f}, \"machine\": \"{}\"}}\n",
      value, kLimit, value / kLimit, Quantile(uncached, 0.5), Quantile(rate, 0.5), policy::DescribeTorch());
  return {};
}

}  // namespace
}  // namespace etude

int main(int argc, char** argv) {
  etude::policy::PrepareTorchProcess(argv);
  const auto status = etude::Main(argc > 1 ? std::max(1, std::atoi(argv[1])) : 40);
  if (!status) fmt::print(stderr, "data_bench: {}\n", status.error().message);
  return status ? 0 : 1;
}
