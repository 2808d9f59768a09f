// SPDX-License-Identifier: Apache-2.0
#include "trainer/learn/ranks.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <netdb.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <torch/csrc/distributed/c10d/HashStore.hpp>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>

#include "services/core/clock.h"
#include "services/core/descriptor.h"
#include "services/core/hash.h"
#include "services/core/log.h"
#include "services/core/stop.h"
#include "trainer/learn/nccl.h"

namespace etude::learn {
namespace {

using Store = c10::intrusive_ptr<c10d::Store>;

Result<Store> OpenStore(const RanksOptions& options) {
  c10d::TCPStoreOptions own;
  own.port = options.port;
  own.isServer = options.rank == 0;
  own.waitWorkers = false;
  own.timeout = options.patience;
  try {
    return Store(c10::make_intrusive<c10d::TCPStore>(options.host, own));
  } catch (const std::exception& error) {
    return Fail(Code::kUnavailable, fmt::format("ranks: {} {}:{}: {}", own.isServer ? "open" : "reach", options.host,
                                                options.port, error.what()));
  }
}

std::string HereKey(int rank) { return fmt::format("here/{}", rank); }
const std::string kCard = "card ";  // a store's values are not empty
std::string CardKey(int rank) { return fmt::format("card/{}", rank); }

void SayCard(c10d::Store& store, const RanksOptions& options) {
  const std::string said = kCard + CardOf(options.device);
  store.set(CardKey(options.rank), std::vector<std::uint8_t>(said.begin(), said.end()));
}

// All have come: every rank reads the same.
std::vector<std::string> Cards(c10d::Store& store, int size) {
  std::vector<std::string> cards;
  for (int rank = 0; rank < size; ++rank) {
    const auto said = store.get(CardKey(rank));
    cards.push_back(std::string(said.begin(), said.end()).substr(kCard.size()));
  }
  return cards;
}

// Before any connects to the others: while it connects it looks at nothing else.
Status WaitForAll(c10d::Store& store, const RanksOptions& options) {
  constexpr std::chrono::milliseconds kLook{100};
  store.set(HereKey(options.rank), std::vector<std::uint8_t>{1});
  const Stopwatch waited;
  const double patience_s = std::chrono::duration<double>(options.patience).count();
  while (true) {
    std::vector<int> absent;
    for (int rank = 0; rank < options.size; ++rank)
      if (!store.check({HereKey(rank)})) absent.push_back(rank);
    if (absent.empty()) return {};
    if (options.watch) ETUDE_RETURN_IF_ERROR(options.watch());
    const std::string who = fmt::format("rank {} of {}: rank {}", options.rank, options.size, fmt::join(absent, ", "));
    if (waited.Seconds() > patience_s)
      return Fail(Code::kUnavailable, fmt::format("{} did not come within {:.0f} s", who, patience_s));
    if (WaitForStop(kLook)) return Fail(Code::kUnavailable, fmt::format("{} had not come when it was stopped", who));
  }
}

// What rank 0 says, as numbers that all ranks get: what it is, then a StepOrder's.
constexpr double kOver = 0, kStep = 1, kWait = 2;
using Order = std::array<double, 3>;

}  // namespace

struct Ranks::Impl {
  RanksOptions options;
  Store store;
  bool over = false, lost = false;
  c10::intrusive_ptr<c10d::ProcessGroupGloo> group;
  CardSum card_sum;  // none: through the host's memory

  // library calls that wait for the others and then say whether it went well; what they throw is that one is gone
  template <class Call>
  Status Together(const char* what, Call&& call) {
    std::string why = "it did not end well";
    try {
      if (call()) return {};
    } catch (const std::exception& error) {
      why = error.what();
    }
    lost = true;
    return Fail(Code::kUnavailable,
                fmt::format("rank {} of {}: another rank was lost while {} ({}); resume from the last saved state",
                            options.rank, options.size, what, why));
  }

  // rank 0's, to all
  Status Tell(Order& order) {
    std::vector<torch::Tensor> said{
        torch::from_blob(order.data(), {static_cast<std::int64_t>(order.size())}, torch::kFloat64)};
    return Together("waiting for the next step",
                    [&] { return group->broadcast(said, c10d::BroadcastOptions())->wait(); });
  }
};

std::string AddressTowards(const std::string& host, std::uint16_t port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;  // to connect one sends nothing
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) return "";
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(found, ::freeaddrinfo);
  const Descriptor socket(::socket(found->ai_family, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_storage own{};
  socklen_t size = sizeof own;
  auto* const address = reinterpret_cast<sockaddr*>(&own);
  std::array<char, NI_MAXHOST> text{};
  if (!socket || ::connect(socket.get(), found->ai_addr, found->ai_addrlen) != 0 ||
      ::getsockname(socket.get(), address, &size) != 0 ||
      ::getnameinfo(address, size, text.data(), text.size(), nullptr, 0, NI_NUMERICHOST) != 0)
    return "";
  return text.data();
}

Result<Meeting> Meeting::Open(const RanksOptions& options) {
  ETUDE_ASSIGN_OR_RETURN(Store store, OpenStore(options));
  Meeting meeting;
  meeting.port_ = options.port;
  if (options.rank == 0) meeting.port_ = static_cast<c10d::TCPStore&>(*store).getPort();
  meeting.store_ = std::make_shared<Store>(std::move(store));
  return meeting;
}

Meeting Meeting::InProcess() {
  Meeting meeting;
  meeting.store_ = std::make_shared<Store>(c10::make_intrusive<c10d::HashStore>());
  return meeting;
}

Result<std::unique_ptr<Ranks>> Ranks::Join(const Meeting& meeting, const RanksOptions& options) {
  if (options.size < 1 || options.rank < 0 || options.rank >= options.size)
    return Fail(Code::kInvalidArgument, fmt::format("rank {}: not one of {}", options.rank, options.size));
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  impl->store = c10::make_intrusive<c10d::PrefixStore>("etude", *static_cast<Store*>(meeting.store_.get()));
  try {
    SayCard(*impl->store, options);
    ETUDE_RETURN_IF_ERROR(WaitForAll(*impl->store, options));
    auto gloo = c10d::ProcessGroupGloo::Options::create(options.patience);
    const bool here = options.host == "127.0.0.1" || options.host == "localhost";
    const std::string own = here ? "127.0.0.1" : AddressTowards(options.host, options.port);
    if (!here && own.starts_with("127."))
      Log().warn("ranks: '{}' is {} here, where no other host finds it: give --meet an address", options.host, own);
    gloo->devices.push_back(own.empty() ? c10d::ProcessGroupGloo::createDefaultDevice()
                                        : c10d::ProcessGroupGloo::createDeviceForHostname(own));
    impl->group = c10::make_intrusive<c10d::ProcessGroupGloo>(impl->store, options.rank, options.size, gloo);
    if (AreCardsApart(Cards(*impl->store, options.size)))
      impl->card_sum = OpenCardSum(c10::make_intrusive<c10d::PrefixStore>("nccl", impl->store), options.rank,
                                   options.size, options.patience);
  } catch (const std::exception& error) {
    return Fail(Code::kUnavailable,
                fmt::format("rank {} of {}: connect to the others: {}", options.rank, options.size, error.what()));
  }
  return std::unique_ptr<Ranks>(new Ranks(std::move(impl)));
}

Ranks::Ranks(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Ranks::~Ranks() = default;

int Ranks::rank() const { return impl_->options.rank; }
int Ranks::size() const { return impl_->options.size; }

bool Ranks::by_nccl() const { return impl_->card_sum != nullptr; }
bool Ranks::lost() const { return impl_->lost; }

Result<StepOrder> Ranks::Agree(const StepOrder& order) {
  Order said{order.go ? kStep : kOver, static_cast<double>(order.level), order.lr};
  do {
    ETUDE_RETURN_IF_ERROR(impl_->Tell(said));
  } while (said[0] == kWait);
  impl_->over = said[0] == kOver;
  return StepOrder{!impl_->over, static_cast<int>(said[1]), said[2]};
}

void Ranks::Abandon() { impl_->lost = true; }

void Ranks::KeepWaiting() {
  if (!leads() || impl_->over || impl_->lost) return;
  Order wait{kWait, 0, 0};
  (void)impl_->Tell(wait);
}

Status Ranks::Sum(torch::Tensor& values) {
  constexpr const char* kWhat = "gradients were summed";
  if (impl_->card_sum && values.device() == impl_->options.device) {
    std::vector<torch::Tensor> tensors{values};
    return impl_->Together(kWhat, [&] { return impl_->card_sum(tensors); });
  }
  // Gloo sums what lies in the host's memory
  std::vector<torch::Tensor> tensors{values.to(torch::kCPU)};
  ETUDE_RETURN_IF_ERROR(
      impl_->Together(kWhat, [&] { return impl_->group->allreduce(tensors, c10d::AllreduceOptions())->wait(); }));
  if (!values.is_cpu()) values.copy_(tensors[0]);
  return {};
}

Status Ranks::CheckSame(const std::string& what, const std::string& value) {
  const std::string own = Sha256Hex(value);
  std::vector<torch::Tensor> first{torch::zeros(static_cast<std::int64_t>(own.size()), torch::kUInt8)};
  std::copy(own.begin(), own.end(), first[0].data_ptr<std::uint8_t>());
  ETUDE_RETURN_IF_ERROR(impl_->Together(
      "comparing with the others", [&] { return impl_->group->broadcast(first, c10d::BroadcastOptions())->wait(); }));
  torch::Tensor different = torch::zeros(1);
  different[0] = std::equal(own.begin(), own.end(), first[0].data_ptr<std::uint8_t>()) ? 0.0F : 1.0F;
  ETUDE_RETURN_IF_ERROR(Sum(different));
  const int count = static_cast<int>(different[0].item<float>());
  if (count == 0) return {};
  return Fail(Code::kInvalidArgument,
              fmt::format("rank {} of {}: {} of the ranks have another {} than rank 0; give all the same", rank(),
                          size(), count, what));
}

}  // namespace etude::learn
