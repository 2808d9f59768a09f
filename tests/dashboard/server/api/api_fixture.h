// SPDX-License-Identifier: Apache-2.0
// The API over the example folders, without a socket and without a bus.
#pragma once

#include <deque>

#include "dashboard/server/api/context.h"
#include "dashboard/server/api/jobs.h"
#include "dashboard/server/gateway.h"
#include "dashboard/server/http/service.h"
#include "tests/dashboard/server/example_folders.h"

namespace etude::api {

inline constexpr const char* kTestToken = "0123456789abcdef0123";

class ApiFixture : public testing::Test {
 protected:
  ApiFixture()
      : sources_({lab_.root()}, cache_ / "replays"),
        jobs_(cache_ / "jobs"),
        security_({.token = kTestToken}),
        context_(
            sources_, [this] { return live_; },
            [this](http::Lane, std::function<void()> work) { later_.push_back(std::move(work)); }, security_, jobs_),
        service_(MakeApi(), security_, [](const http::Request&) -> Result<http::Answer> { return http::Answer{}; }) {}

  http::Answer Ask(http::Request request, const std::string& target) {
    const auto question = target.find('?');
    request.path = http::SplitPath(target.substr(0, question)).value();
    if (question != std::string::npos) request.query = http::Query(target.substr(question + 1));
    request.host = "localhost";
    return service_.Handle(request);
  }
  http::Answer Get(const std::string& target) { return Ask({}, target); }
  OrderedJson GetJson(const std::string& target) {
    const auto answer = Get(target);
    EXPECT_EQ(answer.status, 200) << target << ": " << answer.body;
    return OrderedJson::parse(answer.body, nullptr, false);
  }
  store::Safetensors GetArrays(const std::string& target) {
    const auto answer = Get(target);
    EXPECT_EQ(answer.status, 200) << target << ": " << answer.body;
    const std::span bytes(reinterpret_cast<const std::uint8_t*>(answer.body.data()), answer.body.size());
    return store::DecodeSafetensors(bytes).value_or(store::Safetensors{});
  }
  /// What was put off, to its end.
  void RunLater() {
    while (!later_.empty()) {
      const auto work = std::move(later_.front());
      later_.pop_front();
      work();
    }
  }

  ExampleFolders lab_;
  TemporaryFolder cache_;
  std::shared_ptr<const live::LiveView> live_ = std::make_shared<const live::LiveView>();
  std::deque<std::function<void()>> later_;
  sources::Sources sources_;
  Jobs jobs_;
  http::Security security_;
  Context context_;
  http::Service service_;

 private:
  http::Router MakeApi() {
    context_.videos = cache_ / "videos";
    context_.openapi = dashboard::OpenApiText();
    return MakeRouter(context_);
  }
};

}  // namespace etude::api
