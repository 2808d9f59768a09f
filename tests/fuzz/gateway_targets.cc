// SPDX-License-Identifier: Apache-2.0
// What a browser says on the gateway's WebSocket, up to what is sent back for it. A program of its own: it is linked
// with the gateway.
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/jobs.h"
#include "dashboard/server/api/live_hub.h"
#include "services/core/check.h"
#include "tests/fuzz/targets.h"
#include "tests/support/temporary_folder.h"

namespace etude::fuzz {
namespace {

// What is sent is JSON.
class Listener : public http::Socket {
 public:
  void Send(const std::string&, std::string text) override {
    ETUDE_CHECK(OrderedJson::accept(text), "no JSON: {:.200}", text);
  }
  bool Waits(const std::string&) const override { return false; }
  int slowdown() const override { return 1; }
  std::size_t waiting_bytes() const override { return 0; }
  void Close() override {}
};

// A gateway without network and bus, over a folder that has nothing.
struct Gateway {
  TemporaryFolder folder;
  std::deque<std::function<void()>> later;
  sources::Sources sources{std::vector<Path>{folder.path()}};
  api::Jobs jobs{folder / "jobs"};
  http::Security security{http::SecurityConfig{.token = "0123456789abcdef0123"}};
  std::shared_ptr<const live::LiveView> live = std::make_shared<const live::LiveView>();
  api::Context context{sources, [this] { return live; },
                       [this](http::Lane, std::function<void()> work) { later.push_back(std::move(work)); }, security,
                       jobs};
  api::LiveHub hub{context};
};

// A message a line, as a browser sends them one after the other.
void LiveSocket(std::span<const std::uint8_t> bytes) {
  static Gateway gateway;
  const auto client = gateway.hub.Connect({}, std::make_shared<Listener>());
  std::string message;
  for (const std::uint8_t byte : bytes) {
    if (byte != '\n') {
      message.push_back(static_cast<char>(byte));
      continue;
    }
    client->OnText(message);
    message.clear();
  }
  client->OnText(message);
  gateway.hub.Tick();
  for (; !gateway.later.empty(); gateway.later.pop_front()) gateway.later.front()();
  client->OnClosed();
}

Bytes BytesOf(const std::string& text) { return {text.begin(), text.end()}; }

std::vector<Target> Make() {
  return {
      {"live_socket",
       LiveSocket,
       {BytesOf(R"({"op":"sub","ch":"home","hz":2})"),
        BytesOf(
            "{\"op\":\"sub\",\"ch\":\"fleet\",\"args\":{\"limit\":10},\"id\":\"a\"}\n{\"op\":\"unsub\",\"id\":\"a\"}"),
        BytesOf(R"({"op":"sub","ch":"train","args":{"run":"lab.run","since":50}})"),
        BytesOf(R"({"op":"sub","ch":"logs","args":{"level":"warn","q":"disk","limit":5}})"),
        BytesOf(R"({"op":"sub","ch":"events","args":{"level":"warn"}})"),
        BytesOf("{\"op\":\"auth\",\"token\":\"x\"}\n{\"op\":\"sub\",\"ch\":\"topics\"}")}}};
}

}  // namespace

const std::vector<Target>& Targets() {
  static const std::vector<Target> targets = Make();
  return targets;
}

}  // namespace etude::fuzz
