// SPDX-License-Identifier: Apache-2.0
// Tests trainer/learn/ranks.cc, and that ranks train as replicas do
#include "trainer/learn/ranks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <thread>

#include "services/core/clock.h"
#include "tests/trainer/learn/tiny_run.h"
#include "trainer/learn/nccl.h"
#include "trainer/learn/run.h"

namespace etude::learn {
namespace ranks_test {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

// runs `work` as so many ranks, each a thread
template <class Work>
void AsRanks(int size, Work&& work, std::chrono::milliseconds patience = 30s, torch::Device device = torch::kCPU) {
  const Meeting meeting = Meeting::InProcess();
  std::vector<std::thread> threads;
  for (int rank = 0; rank < size; ++rank)
    threads.emplace_back([&, rank] {
      auto ranks = Ranks::Join(meeting, {.size = size, .rank = rank, .device = device, .patience = patience});
      ASSERT_TRUE(ranks) << ranks.error().message;
      work(std::shared_ptr<Ranks>(std::move(*ranks)));
    });
  for (auto& thread : threads) thread.join();
}

// each said what its own name stands for: 127.0.1.1 on a Debian host, where the others found themselves
TEST(Ranks, SayTheAddressFromWhichTheyReachRankZero) {
  EXPECT_EQ(AddressTowards("127.0.0.1", 7000), "127.0.0.1");
  EXPECT_EQ(AddressTowards(std::string(300, 'x'), 7000), "");  // no name: nobody is asked
  ifaddrs* all = nullptr;
  ASSERT_EQ(::getifaddrs(&all), 0);
  for (const ifaddrs* one = all; one; one = one->ifa_next) {  // each address of this machine is reached from itself
    if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET || (one->ifa_flags & IFF_LOOPBACK)) continue;
    char text[NI_MAXHOST];
    ASSERT_EQ(::getnameinfo(one->ifa_addr, sizeof(sockaddr_in), text, sizeof text, nullptr, 0, NI_NUMERICHOST), 0);
    EXPECT_EQ(AddressTowards(text, 7000), text);
  }
  ::freeifaddrs(all);
}

TEST(Ranks, SumAndFollowTheOrdersOfRankZero) {
  AsRanks(3, [](const std::shared_ptr<Ranks>& ranks) {
    auto values = torch::full({5}, static_cast<float>(ranks->rank() + 1));
    ASSERT_TRUE(ranks->Sum(values));
    EXPECT_TRUE(torch::equal(values, torch::full({5}, 6.0F)));
    const auto order = ranks->Agree({ranks->leads(), 10 * ranks->rank() + 4, 0.25 * (ranks->rank() + 1)});
    ASSERT_TRUE(order);
    EXPECT_TRUE(order->go);
    EXPECT_EQ(order->level, 4);
    EXPECT_EQ(order->lr, 0.25);
    EXPECT_TRUE(ranks->CheckSame("configuration", "same"));
    const Status different = ranks->CheckSame("dataset", ranks->rank() == 2 ? "b" : "a");
    ASSERT_FALSE(different);
    EXPECT_THAT(different.error().message, HasSubstr("1 of the ranks have another dataset"));
  });
}

TEST(Ranks, TellWhetherEachHasACardOfItsOwn) {
  EXPECT_TRUE(AreCardsApart({"a"}));
  EXPECT_TRUE(AreCardsApart({"a", "b", "c"}));
  EXPECT_FALSE(AreCardsApart({"a", "b", "a"})) << "two ranks on one";
  EXPECT_FALSE(AreCardsApart({"a", ""})) << "one without";
  EXPECT_EQ(CardOf(torch::kCPU), "");
  AsRanks(2, [](const std::shared_ptr<Ranks>& ranks) { EXPECT_FALSE(ranks->by_nccl()); });
}

TEST(Ranks, OnOneCardSumInTheHostsMemory) {
  if (!torch::cuda::is_available()) GTEST_SKIP() << "no CUDA device";
  AsRanks(
      2,
      [](const std::shared_ptr<Ranks>& ranks) {
        EXPECT_FALSE(ranks->by_nccl());
        auto values = torch::full({5}, static_cast<float>(ranks->rank() + 1), torch::kCUDA);
        ASSERT_TRUE(ranks->Sum(values));
        EXPECT_TRUE(torch::equal(values.to(torch::kCPU), torch::full({5}, 3.0F)));
      },
      30s, torch::Device(torch::kCUDA, 0));
}

// more need more cards than the machine that this was written on had
TEST(Ranks, OnCardsOfTheirOwnSumByNccl) {
  const auto cards = static_cast<int>(torch::cuda::device_count());
  if (cards == 0 || CardOf(torch::Device(torch::kCUDA, 0)).empty()) GTEST_SKIP() << "no CUDA device, or no NCCL";
  const Meeting meeting = Meeting::InProcess();
  std::vector<std::thread> threads;
  for (int rank = 0; rank < cards; ++rank)
    threads.emplace_back([&, rank] {
      const torch::Device device(torch::kCUDA, static_cast<c10::DeviceIndex>(rank));
      const auto ranks = Ranks::Join(meeting, {.size = cards, .rank = rank, .device = device, .patience = 30s});
      ASSERT_TRUE(ranks) << ranks.error().message;
      EXPECT_TRUE((*ranks)->by_nccl());
      auto values = torch::full({5}, static_cast<float>(rank + 1), device);
      const Status summed = (*ranks)->Sum(values);
      ASSERT_TRUE(summed) << summed.error().message;
      EXPECT_TRUE(torch::equal(values.to(torch::kCPU), torch::full({5}, cards * (cards + 1) / 2.0F)));
      auto here = torch::full({5}, 2.0F);
      ASSERT_TRUE((*ranks)->Sum(here));
      EXPECT_TRUE(torch::equal(here, torch::full({5}, 2.0F * cards))) << "what lies in the host's memory, too";
    });
  for (auto& thread : threads) thread.join();
}

TEST(Ranks, EndWithWordsWhenOneIsLost) {
  AsRanks(2, [](const std::shared_ptr<Ranks>& ranks) {
    if (!ranks->leads()) return;  // gone
    Status lost;
    auto values = torch::ones({4});
    for (int i = 0; i < 100 && lost; ++i) lost = ranks->Sum(values);
    ASSERT_FALSE(lost);
    EXPECT_EQ(lost.error().code, Code::kUnavailable);
    EXPECT_THAT(lost.error().message, HasSubstr("rank 0 of 2: another rank was lost"));
    EXPECT_TRUE(ranks->lost());
  });
}

// before, the others were waited for in silence, five minutes long
TEST(Ranks, EndTheirWaitForOneThatNeverComes) {
  int asked = 0;
  const auto watched =
      Ranks::Join(Meeting::InProcess(), {.size = 3, .watch = [&]() -> Status {
                                           if (++asked < 3) return {};
                                           return Fail(Code::kUnavailable, "rank 2 ended with exit code 7");
                                         }});
  ASSERT_FALSE(watched);
  EXPECT_EQ(watched.error().message, "rank 2 ended with exit code 7");
  EXPECT_EQ(asked, 3);

  const auto alone = Ranks::Join(Meeting::InProcess(), {.size = 3, .patience = 1s});
  ASSERT_FALSE(alone);
  EXPECT_EQ(alone.error().code, Code::kUnavailable);
  EXPECT_EQ(alone.error().message, "rank 0 of 3: rank 1, 2 did not come within 1 s");
}

TEST(Ranks, WaitOnWhileRankZeroSaysThatItIsThere) {
  AsRanks(2, [](const std::shared_ptr<Ranks>& ranks) {
    for (int i = 0; i < 3; ++i) ranks->KeepWaiting();
    const auto order = ranks->Agree({true, ranks->leads() ? 3 : 0, 0.5});
    ASSERT_TRUE(order);
    EXPECT_TRUE(order->go);
    EXPECT_EQ(order->level, 3) << "a wait is no order";
    const auto last = ranks->Agree({!ranks->leads()});
    ASSERT_TRUE(last);
    EXPECT_FALSE(last->go);
    ranks->KeepWaiting();  // nobody listens any more
    EXPECT_FALSE(ranks->lost());
  });
}

TEST(Ranks, AreNumbered) {
  EXPECT_EQ(Ranks::Join(Meeting::InProcess(), {.size = 2, .rank = 2}).error().code, Code::kInvalidArgument);
}

class RanksTrain : public ::testing::Test {
 protected:
  void SetUp() override {
    at::set_num_threads(1);
    dataset_ = TinyDataset(folder_ / "d", 24);
  }
  // the last checkpoint's tensors
  std::map<std::string, torch::Tensor> Train(const TrainConfig& config, const Path& out,
                                             std::shared_ptr<Ranks> ranks = nullptr, bool resume = false) {
    std::map<std::string, torch::Tensor> kept;
    Hooks hooks;
    hooks.on_checkpoint = [&](const checkpoint::Checkpoint& made) -> Status {
      for (const auto& [name, tensor] : made.tensors) kept[name] = tensor.detach().clone();
      return {};
    };
    auto trainer = Trainer::Create(config, dataset_,
                                   {.out = out, .resume = resume, .ranks = std::move(ranks), .replicas = 2}, hooks);
    EXPECT_TRUE(trainer) << trainer.error().message;
    if (!trainer) return kept;
    const Status done = (*trainer)->Run();
    EXPECT_TRUE(done) << done.error().message;
    return kept;
  }

  using Tensors = std::map<std::string, torch::Tensor>;
  // of all weights together
  static double RelativeDistance(const Tensors& made, const Tensors& wanted) {
    EXPECT_EQ(made.size(), wanted.size());
    double moved = 0, length = 0;
    for (const auto& [name, tensor] : wanted) {
      if (!made.contains(name)) continue;
      moved += (made.at(name) - tensor).to(torch::kFloat64).square().sum().item<double>();
      length += tensor.to(torch::kFloat64).square().sum().item<double>();
    }
    return std::sqrt(moved / length);
  }

  TemporaryFolder folder_;
  std::shared_ptr<data::Dataset> dataset_;
};

// 100 steps in float32; what differs is the order in which two sums are added
TEST_F(RanksTrain, TwoRanksAreOneRankWithTwoReplicas) {
  const std::vector<std::string> common{"steps=100", "eval.every_steps=50", "checkpoint.every_steps=1000",
                                        "curriculum.enabled=false"};
  auto two = common, one = common;
  two.push_back("threads.replicas=2");
  one.push_back("threads.replicas=1");
  const auto wanted = Train(TinyConfig(two), folder_ / "replicas");
  std::map<std::string, torch::Tensor> made;
  AsRanks(2, [&](const std::shared_ptr<Ranks>& ranks) {
    auto kept = Train(TinyConfig(one), folder_ / "ranks", ranks);
    EXPECT_EQ(kept.empty(), !ranks->leads()) << "rank 0 keeps";
    if (ranks->leads()) made = std::move(kept);
  });

  EXPECT_LT(RelativeDistance(made, wanted), 1e-5);
}

// a run that moves to more machines keeps its parts of a batch, and comes to the same weights
TEST_F(RanksTrain, ARunOfOneRankGoesOnAsTwo) {
  const auto config = [](const char* steps) {
    return TinyConfig({steps, "eval.every_steps=20", "checkpoint.every_steps=1000", "curriculum.enabled=false",
                       "threads.replicas=0", "data.batch=16"});
  };
  const auto begun = Train(config("steps=40"), folder_ / "alone");
  std::filesystem::copy(folder_ / "alone", folder_ / "together", std::filesystem::copy_options::recursive);
  ASSERT_EQ(LoadRunState(folder_ / "alone/training_state.safetensors").value().replicas, 2);
  const auto wanted = Train(config("steps=80"), folder_ / "alone", nullptr, true);
  Tensors made;
  AsRanks(2, [&](const std::shared_ptr<Ranks>& ranks) {
    auto kept = Train(config("steps=80"), folder_ / "together", ranks, true);
    if (ranks->leads()) made = std::move(kept);
  });

  EXPECT_LT(RelativeDistance(made, wanted), 1e-5);
  EXPECT_GT(RelativeDistance(begun, wanted), 1e-3) << "it went on";
  EXPECT_EQ(LoadRunState(folder_ / "together/training_state.safetensors").value().replicas, 2);
}

TEST_F(RanksTrain, RefuseToTrainDifferentThingsTogether) {
  AsRanks(2, [&](const std::shared_ptr<Ranks>& ranks) {
    const auto config = TinyConfig({ranks->leads() ? "seed=1" : "seed=2"});
    const auto trainer = Trainer::Create(config, dataset_, {.out = folder_ / "different", .ranks = ranks}, {});
    ASSERT_FALSE(trainer);
    EXPECT_THAT(trainer.error().message, HasSubstr("another configuration than rank 0"));
  });
}

// before, what was learned since the last checkpoint was lost with the rank
TEST_F(RanksTrain, WhenARankIsLostRankZeroKeepsWhatItHas) {
  const auto config = TinyConfig({"steps=5000", "eval.every_steps=5000", "checkpoint.every_steps=5000"});
  constexpr int kTogether = 4;
  AsRanks(2, [&](const std::shared_ptr<Ranks>& ranks) {
    const RunOptions options{.out = folder_ / "lost", .ranks = ranks};
    if (!ranks->leads()) {
      auto run = BuildRun(config, dataset_, options);
      ASSERT_TRUE(run) << run.error().message;
      for (int i = 0; i < kTogether; ++i) {
        ASSERT_TRUE(ranks->Agree({}));
        (*run)->optimizer->ZeroGradients();
        ASSERT_TRUE(ranks->Sum((*run)->optimizer->SumGradients()));
      }
      return;  // gone
    }
    int kept = 0;
    Hooks hooks;
    hooks.on_checkpoint = [&](const checkpoint::Checkpoint&) -> Status {
      ++kept;
      return {};
    };
    auto trainer = Trainer::Create(config, dataset_, options, hooks);
    ASSERT_TRUE(trainer) << trainer.error().message;
    const Status ended = (*trainer)->Run();
    ASSERT_FALSE(ended);
    EXPECT_EQ(ended.error().code, Code::kUnavailable);
    EXPECT_THAT(ended.error().message, HasSubstr("can be resumed"));
    EXPECT_EQ(kept, 1);
  });
  const auto state = LoadRunState(folder_ / "lost/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_GE(state->step, 1u);
  EXPECT_LE(state->step, static_cast<std::uint64_t>(kTogether));
}

// before, the others ended after their patience, though rank 0 alone waits for as long as it takes
TEST_F(RanksTrain, AFullDiskAtRankZeroIsWaitedForLongerThanAnyPatience) {
  constexpr auto kPatience = 15s;
  const auto config = TinyConfig({"steps=20", "checkpoint.every_steps=10"});
  AsRanks(
      2,
      [&](const std::shared_ptr<Ranks>& ranks) {
        std::optional<Stopwatch> full;
        Hooks hooks;
        hooks.on_checkpoint = [&](const checkpoint::Checkpoint&) -> Status {
          if (!full) full.emplace();
          if (full->Seconds() > 20) return {};
          return Fail(Code::kUnavailable, "no space left on device");
        };
        auto trainer = Trainer::Create(config, dataset_, {.out = folder_ / "full", .ranks = ranks}, hooks);
        ASSERT_TRUE(trainer) << trainer.error().message;
        const Status ended = (*trainer)->Run();
        EXPECT_TRUE(ended) << "rank " << ranks->rank() << ": " << ended.error().message;
      },
      kPatience);
  const auto state = LoadRunState(folder_ / "full/training_state.safetensors");
  ASSERT_TRUE(state) << state.error().message;
  EXPECT_EQ(state->step, 20u);
}

TEST_F(RanksTrain, OfAGrowingDatasetNormaliseByWhatRankZeroSaw) {
  const auto grown = TinyDataset(folder_ / "grown", 40);
  const auto config = TinyConfig();
  std::map<std::string, torch::Tensor> states[2];
  AsRanks(2, [&](const std::shared_ptr<Ranks>& ranks) {
    const auto run = BuildRun(config, ranks->leads() ? dataset_ : grown,
                              {.out = folder_ / "following", .follow = true, .ranks = ranks});
    ASSERT_TRUE(run) << run.error().message;
    auto& state = states[ranks->rank()];
    for (const auto& [name, tensor] : (*run)->replicas->front().StateTensors())
      if (name.starts_with("normalization_")) state[name] = tensor.detach().clone();
  });
  ASSERT_EQ(states[0].size(), 6u);
  for (const auto& [name, tensor] : states[0]) EXPECT_TRUE(torch::equal(states[1].at(name), tensor)) << name;
}

}  // namespace ranks_test
}  // namespace etude::learn
