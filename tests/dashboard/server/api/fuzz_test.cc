// SPDX-License-Identifier: Apache-2.0
// Tests the parsers of requests and every route with requests that nobody would send: seeded, bounded, never a crash,
// never an answer that is no answer.
#include <random>

#include "tests/dashboard/server/api/api_fixture.h"

namespace etude::api {
namespace fuzz_test {

constexpr int kRounds = 2000;

class Fuzz : public ApiFixture {
 protected:
  std::size_t Below(std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(rng_); }
  std::string Bytes(std::size_t most) {
    std::string text(Below(most + 1), '\0');
    for (char& c : text) c = static_cast<char>(Below(256));
    return text;
  }
  // A few bytes changed, dropped, doubled or put in.
  std::string Mutated(std::string text) {
    static constexpr const char* kBad[] = {
        "..",   "%2F", "%00", "%", "/",   "{}", "[", "\"", "-1", "1e999", "18446744073709551616",
        "\xff", "?",   "&",   "=", "null"};
    for (std::size_t i = 0, n = 1 + Below(4); i < n; ++i) {
      const std::size_t at = Below(text.size() + 1);
      switch (Below(4)) {
        case 0:
          text.insert(at, kBad[Below(std::size(kBad))]);
          break;
        case 1:
          text.insert(at, Bytes(3));
          break;
        case 2:
          text = text.substr(0, at);
          break;
        default:
          if (at < text.size()) text[at] = static_cast<char>(Below(256));
      }
    }
    return text;
  }
  // The address of a route with something in place of its {names}.
  std::string Filled(const std::string& pattern) {
    static const std::vector<std::string> kNames{"lab.data",
                                                 "lab.run",
                                                 "lab.eval_a",
                                                 "lab.eval_b",
                                                 "0",
                                                 "1",
                                                 "front",
                                                 "00000200.safetensors",
                                                 "etude%2Fprocess%2Fstatus",
                                                 "none"};
    std::string address;
    for (std::size_t at = 0; at < pattern.size(); ++at) {
      if (pattern[at] != '{') {
        address += pattern[at];
        continue;
      }
      address += kNames[Below(kNames.size())];
      at = pattern.find('}', at);
    }
    return address;
  }
  std::mt19937_64 rng_{20260131};
};

TEST_F(Fuzz, ParsersTakeAnyBytes) {
  for (int i = 0; i < kRounds; ++i) {
    const std::string text =
        i % 2 == 0 ? Bytes(200) : Mutated("/api/v1/datasets/lab.data/episodes/1?task=pick&limit=2");
    if (const auto path = http::SplitPath(text)) {
      for (const auto& segment : *path) {
        EXPECT_NE(segment, "..");
        EXPECT_EQ(segment.find('\0'), std::string::npos);
      }
    }
    (void)http::PercentDecoded(text, true);
    const http::Query query(text);
    (void)query.Integer("limit", 1, 0, 10);
    (void)query.All("task");
  }
}

TEST_F(Fuzz, EveryRouteAnswersWhateverItIsAsked) {
  std::vector<http::Route> routes;
  for (const auto& route : service_.router().routes())
    if (route.method == "GET" || route.method == "POST") routes.push_back(route);
  const std::vector<std::string> bodies{
      R"({"action":"evaluate","run":"lab.run","file":"00000200.safetensors","dry_run":true})",
      R"({"action":"pause","campaign":"lab.data","dry_run":true})", R"({"token":"wrong"})",
      R"({"run":"lab.run","source":{"dataset":"lab.data","episode":1,"picture":0},"what_if":{"hide":[[1,2,3,4]]}})"};
  const std::vector<std::string> queries{"limit=2&offset=1", "task=pick&sort=-steps&steps=1..9",
                                         "keys=train/loss&x=time&points=9", "names=eef_pos&from=1&to=9", "w=64"};
  for (int i = 0; i < kRounds; ++i) {
    const auto& route = routes[Below(routes.size())];
    std::string target = Filled(route.pattern) + "?" + queries[Below(queries.size())];
    if (Below(3) != 0) target = Mutated(target);
    const auto question = target.find('?');
    const auto path = http::SplitPath(target.substr(0, question));
    if (!path) continue;
    http::Request request;
    request.method = Below(20) == 0 ? Bytes(8) : route.method;
    request.path = *path;
    if (question != std::string::npos) request.query = http::Query(target.substr(question + 1));
    request.host = Below(20) == 0 ? Bytes(20) : "localhost";
    request.content_type = "application/json";
    request.body = Mutated(bodies[Below(bodies.size())]);
    request.range = Mutated("bytes=0-9");
    request.cookie = Below(2) == 0 ? Bytes(40) : "";
    const auto answer = service_.Handle(request);
    EXPECT_GE(answer.status, 200) << target;
    EXPECT_LT(answer.status, 600) << target;
    EXPECT_NE(answer.status, 500) << target << ": " << answer.body;
    EXPECT_NE(answer.status, 202) << "no action without the token: " << request.body;
    if (i % 50 == 0) RunLater();
  }
  EXPECT_EQ(jobs_.All().size(), 0u);
}

}  // namespace fuzz_test
}  // namespace etude::api
