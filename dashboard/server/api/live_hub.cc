// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/api/live_hub.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "services/episode/bounded_json.h"

namespace etude::api {
namespace {

constexpr std::size_t kMostSubscriptions = 16;  // of a browser
constexpr std::size_t kMostSnapshots = 200;
constexpr double kLeastHz = 0.2;
constexpr std::size_t kMostId = 2000;  // bytes: a channel and what it is asked for, names of hosts and texts among it

struct Channel {
  const char* name;
  double top_hz;
};
constexpr Channel kChannels[] = {{"home", 2}, {"fleet", 2},  {"attempts", 1}, {"train", 1},  {"eval", 1},
                                 {"logs", 4}, {"events", 2}, {"topics", 1},   {"sample", 4}, {"play", 10}};

// How old a snapshot may be that several browsers share.
std::chrono::milliseconds FreshFor(const std::string& channel) {
  return std::chrono::milliseconds(channel == "play" ? 80 : 200);
}

const Channel* FindChannel(const std::string& name) {
  for (const auto& channel : kChannels)
    if (name == channel.name) return &channel;
  return nullptr;
}

// Arguments as the parameters that the route of the same name takes.
http::Query QueryOf(const OrderedJson& arguments) {
  std::string text;
  const auto escaped = [](const std::string& value) {
    std::string result;
    for (const char c : value) result += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    return result;
  };
  if (arguments.is_object())
    for (const auto& [key, value] : arguments.items())
      text += (text.empty() ? "" : "&") + escaped(key) + "=" +
              escaped(value.is_string() ? value.get<std::string>() : value.dump());
  return http::Query(text);
}

}  // namespace

// One browser.
class LiveHub::Client : public http::SocketClient, public std::enable_shared_from_this<Client> {
 public:
  explicit Client(std::shared_ptr<http::Socket> socket) : socket_(std::move(socket)) {}

  void OnText(const std::string& text) override {
    const auto message = ParseBoundedJson(text, 8);
    if (!message || !message->is_object()) return Complain("", "", "not a JSON object");
    const std::string op = sources::TextOf(*message, "op");
    const std::string channel = sources::TextOf(*message, "ch");
    const std::string id = sources::TextOf(*message, "id", channel);
    // no channel of today needs the token; it is taken so that clients need not know
    if (op == "auth") return;
    if (op == "unsub") {
      MutexLock lock(mutex_);
      std::erase_if(subscriptions_, [&](const auto& item) { return item.id == id; });
      return;
    }
    if (op != "sub") return Complain(channel, id, "op: sub, unsub or auth");
    Subscribe(channel, id, *message);
  }

  void OnClosed() override {
    MutexLock lock(mutex_);
    subscriptions_.clear();
  }

  // What is due now; each is under way until Done.
  std::vector<Subscription> Due() {
    std::vector<Subscription> due;
    const auto now = MonotonicClock::now();
    MutexLock lock(mutex_);
    for (auto& item : subscriptions_) {
      if (item.under_way || item.due > now || socket_->Waits(item.id)) continue;
      item.under_way = true;
      // a browser that takes long is asked less often, but not below once in two seconds for it
      const auto slowed = std::min<std::chrono::milliseconds>(item.period * socket_->slowdown(),
                                                              std::max(item.period, std::chrono::milliseconds(2000)));
      item.due = now + slowed;
      due.push_back(item);
    }
    return due;
  }

  void Done(const Subscription& subscription, const std::string& data) {
    std::uint64_t sequence = 0;
    {
      MutexLock lock(mutex_);
      const auto item = std::ranges::find(subscriptions_, subscription.id, &Subscription::id);
      if (item == subscriptions_.end()) return;
      item->under_way = false;
      if (item->key != subscription.key) return;  // it asks for something else by now
      sequence = ++sequence_;
    }
    socket_->Send(
        subscription.id,
        fmt::format(R"({{"ch":{},"id":{},"seq":{},"t":"{}",{}}})", JsonText(OrderedJson(subscription.channel)),
                    JsonText(OrderedJson(subscription.id)), sequence, sources::Rfc3339(WallSeconds()), data));
  }

 private:
  void Complain(const std::string& channel, const std::string& id, const std::string& error) {
    socket_->Send("error " + id, JsonText({{"ch", channel}, {"id", id}, {"error", error}}));
  }

  void Subscribe(const std::string& name, const std::string& id, const OrderedJson& message) {
    const Channel* channel = FindChannel(name);
    if (!channel) return Complain(name, id, "there is no such channel");
    if (id.size() > kMostId) return Complain(name, id.substr(0, 100), "id: too long");
    Subscription item;
    item.id = id;
    item.channel = name;
    item.arguments = sources::PartOf(message, "args");
    item.key = name + JsonText(item.arguments);
    const double hz = std::clamp(sources::NumberOf(message, "hz").value_or(channel->top_hz), kLeastHz, channel->top_hz);
    item.period = std::chrono::milliseconds(std::llround(1000 / hz));
    MutexLock lock(mutex_);
    const auto known = std::ranges::find(subscriptions_, id, &Subscription::id);
    if (known != subscriptions_.end()) {
      // what is under way goes on; asked for again, the same is due as before, at the rate that is wished now
      item.under_way = known->under_way;
      if (known->key == item.key) item.due = known->due - known->period + item.period;
      *known = std::move(item);
    } else if (subscriptions_.size() < kMostSubscriptions)
      subscriptions_.push_back(std::move(item));
    else
      Complain(name, id, fmt::format("at most {} subscriptions", kMostSubscriptions));
  }

  const std::shared_ptr<http::Socket> socket_;
  Mutex mutex_;
  std::vector<Subscription> subscriptions_ ETUDE_GUARDED_BY(mutex_);
  std::uint64_t sequence_ ETUDE_GUARDED_BY(mutex_) = 0;
};

LiveHub::LiveHub(Context& context, std::size_t most_bytes) : context_(context), most_bytes_(most_bytes) {}
LiveHub::~LiveHub() = default;

std::shared_ptr<http::SocketClient> LiveHub::Connect(const http::Request&, std::shared_ptr<http::Socket> socket) {
  auto client = std::make_shared<Client>(std::move(socket));
  MutexLock lock(mutex_);
  clients_.push_back(client);
  return client;
}

std::size_t LiveHub::clients() const {
  MutexLock lock(mutex_);
  return static_cast<std::size_t>(
      std::ranges::count_if(clients_, [](const auto& client) { return !client.expired(); }));
}

// "data":… or "error":…
std::string LiveHub::Compute(const Subscription& subscription) {
  const std::string& channel = subscription.channel;
  const OrderedJson& arguments = subscription.arguments;
  const auto answered = [&]() -> Result<OrderedJson> {
    if (channel == "home") return HomeJson(context_);
    if (channel == "fleet") return FleetJson(context_, QueryOf(arguments));
    if (channel == "attempts") return LatestAttempts(context_, sources::TextOf(arguments, "campaign"));
    if (channel == "train")
      return TrainNews(context_, sources::TextOf(arguments, "run"),
                       sources::UnsignedOf(arguments, "since").value_or(0));
    if (channel == "play") return PlayJson(context_, sources::TextOf(arguments, "session"));
    if (channel == "eval") return EvalJson(context_, sources::TextOf(arguments, "id"));
    if (channel == "events") return EventsJson(context_, QueryOf(arguments));
    if (channel == "topics") return TopicsJson(context_);
    if (channel == "sample") return SampleJson(context_, sources::TextOf(arguments, "topic"));
    return LogsJson(context_, QueryOf(arguments));
  };
  // what is thrown must reach the browser, too: it waits for an answer before it is sent another
  const auto json = [&]() -> Result<OrderedJson> {
    try {
      return answered();
    } catch (const std::exception& error) {
      return Fail(Code::kInternal, error.what());
    }
  }();
  if (!json) return "\"error\":" + JsonText(OrderedJson(json.error().message));
  return "\"data\":" + JsonText(*json);
}

// They are fresh for a moment only: where there is no room, all are let go. One that is larger than the room is made
// for each browser.
void LiveHub::Keep(const std::string& key, const std::string& text) {
  const auto before = snapshots_.find(key);
  if (before != snapshots_.end()) {
    snapshot_bytes_ -= before->second.text.size();
    snapshots_.erase(before);
  }
  if (snapshots_.size() >= kMostSnapshots || snapshot_bytes_ + text.size() > most_bytes_) {
    snapshots_.clear();
    snapshot_bytes_ = 0;
  }
  if (text.size() > most_bytes_) return;
  snapshots_[key] = {text, MonotonicClock::now()};
  snapshot_bytes_ += text.size();
}

std::size_t LiveHub::kept_bytes() const {
  MutexLock lock(mutex_);
  return snapshot_bytes_;
}

void LiveHub::Deliver(const std::shared_ptr<Client>& client, const Subscription& subscription) {
  {
    MutexLock lock(mutex_);
    const auto made = snapshots_.find(subscription.key);
    if (made != snapshots_.end() && MonotonicClock::now() - made->second.made < FreshFor(subscription.channel))
      return client->Done(subscription, made->second.text);
  }
  const std::string text = Compute(subscription);
  {
    MutexLock lock(mutex_);
    Keep(subscription.key, text);
  }
  client->Done(subscription, text);
}

void LiveHub::Tick() {
  std::vector<std::shared_ptr<Client>> clients;
  {
    MutexLock lock(mutex_);
    std::erase_if(clients_, [](const auto& client) { return client.expired(); });
    for (const auto& client : clients_)
      if (auto held = client.lock()) clients.push_back(std::move(held));
  }
  for (const auto& client : clients)
    for (auto& subscription : client->Due())
      context_.later(http::Lane::kFiles, [this, client, subscription] { Deliver(client, subscription); });
}

}  // namespace etude::api
