// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/security.cc and service.cc: who may ask what.
#include "dashboard/server/http/security.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "dashboard/server/http/service.h"

namespace etude::http {
namespace security_test {

constexpr const char* kToken = "0123456789abcdef0123";

Request Ask(const std::string& host, const std::string& method = "GET", const std::string& path = "/api/v1/home") {
  Request request;
  request.method = method;
  request.path = SplitPath(path).value();
  request.host = host;
  request.local_address = "192.168.0.7";
  return request;
}

Service MakeService(SecurityConfig config) {
  const Handler ok = [](const Request&) -> Result<Answer> { return Answer{}; };
  Router router;
  router.Add("GET", "/api/v1/home", Lane::kFiles, ok);
  router.Add("POST", "/api/v1/act", Lane::kFiles, ok, Access::kAction);
  router.Add("POST", "/api/v1/session", Lane::kFiles, ok, Access::kSignIn);
  router.Add("GET", "/healthz", Lane::kFiles, ok, Access::kPublic);
  router.Add("GET", "/throws", Lane::kFiles, [](const Request&) -> Result<Answer> { throw std::runtime_error("bug"); });
  return {std::move(router), Security(std::move(config)), ok};
}

TEST(HostName, IsWhatStandsBeforeThePort) {
  EXPECT_EQ(HostName("LocalHost:8080"), "localhost");
  EXPECT_EQ(HostName("[::1]:8080"), "::1");
  EXPECT_EQ(HostName("lab-7.example"), "lab-7.example");
  for (const char* text : {"", "a b", "x:", "x:80a", "[::1", "[::1]x", "a/b", "x:1234567", "a\"b"})
    EXPECT_EQ(HostName(text), "") << text;
}

TEST(Service, AnswersOnlyToNamesThatItIsKnownBy) {
  const auto service = MakeService({.hosts = {"lab-7"}});
  for (const char* host :
       {"localhost", "localhost:9000", "127.0.0.1:8080", "[::1]:8080", "192.168.0.7", "lab-7:8080"}) {
    auto request = Ask(host);
    EXPECT_EQ(service.Handle(request).status, 200) << host;
  }
  for (const char* host : {"evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "", "192.168.0.8"}) {
    auto request = Ask(host);
    request.origin = "http://" + std::string(host);  // what DNS rebinding makes equal
    EXPECT_EQ(service.Handle(request).status, 403) << host;
    EXPECT_TRUE(service.CheckSocket(request)) << host;
  }
  auto probe = Ask("10.0.0.3:8080", "GET", "/healthz");
  EXPECT_EQ(service.Handle(probe).status, 200) << "probes come under whatever name";
}

TEST(Service, PagesOfOtherOriginsLearnNothing) {
  const auto service = MakeService({});
  for (const auto& [site, status] :
       {std::pair{"", 200}, {"none", 200}, {"same-origin", 200}, {"same-site", 403}, {"cross-site", 403}}) {
    auto request = Ask("localhost");
    request.fetch_site = site;
    EXPECT_EQ(service.Handle(request).status, status) << site;
  }
  auto page = Ask("localhost", "GET", "/training");
  page.fetch_site = "cross-site";
  EXPECT_EQ(service.Handle(page).status, 200) << "a link to the pages may be followed";
}

TEST(Service, OtherPagesNeitherActNorListen) {
  const auto service = MakeService({.token = kToken});
  for (const char* origin : {"http://evil.example", "null", "http://localhost:8081"}) {
    auto request = Ask("localhost:8080", "POST", "/api/v1/act");
    request.authorization = fmt::format("Bearer {}", kToken);
    request.origin = origin;
    EXPECT_EQ(service.Handle(request).status, 403) << origin;
    EXPECT_TRUE(service.CheckSocket(request)) << origin;
  }
  auto own = Ask("localhost:8080", "POST", "/api/v1/act");
  own.authorization = fmt::format("Bearer {}", kToken);
  own.origin = "http://localhost:8080";
  EXPECT_EQ(service.Handle(own).status, 200);
  EXPECT_FALSE(service.CheckSocket(own));
}

TEST(Service, ActionsNeedTheToken) {
  const auto without = MakeService({});
  auto request = Ask("localhost", "POST", "/api/v1/act");
  request.authorization = "Bearer ";
  EXPECT_EQ(without.Handle(request).status, 403) << "there is none, so that nothing matches";

  const auto service = MakeService({.token = kToken});
  struct Case {
    std::string authorization, cookie;
    int status;
  };
  const std::string cookie = service.security().CookieHeader();
  const std::string session = cookie.substr(0, cookie.find(';'));
  for (const auto& [authorization, cookies, status] :
       {Case{"", "", 401}, Case{"Bearer wrong", "", 401}, Case{kToken, "", 401},
        Case{fmt::format("Bearer {}", kToken), "", 200}, Case{"", session, 200}, Case{"", "a=b; " + session, 200},
        Case{"", session.substr(0, session.find('=') + 1) + kToken, 401},
        Case{"", session.substr(0, session.find('=') + 1), 401}}) {
    auto act = Ask("localhost", "POST", "/api/v1/act");
    act.authorization = authorization;
    act.cookie = cookies;
    EXPECT_EQ(service.Handle(act).status, status) << authorization << " | " << cookies;
    auto read = Ask("localhost");
    EXPECT_EQ(service.Handle(read).status, 200) << "on this machine reads need none";
  }
  EXPECT_EQ(session.find(kToken), std::string::npos) << "the cookie is not the token";
}

// a browser keeps the cookies of a host, not of its ports
TEST(Service, TwoGatewaysOnAHostDoNotSignEachOtherOut) {
  const auto one = MakeService({.token = kToken}), other = MakeService({.token = "another token of its own"});
  std::map<std::string, std::string> browser;  // cookies by name
  for (const auto* service : {&one, &other}) {
    const std::string header = service->security().CookieHeader(), cookie = header.substr(0, header.find(';'));
    browser[cookie.substr(0, cookie.find('='))] = cookie;
  }
  std::string cookies;
  for (const auto& [name, cookie] : browser) cookies += (cookies.empty() ? "" : "; ") + cookie;
  for (const auto* service : {&one, &other}) {
    auto act = Ask("localhost", "POST", "/api/v1/act");
    act.cookie = cookies;
    EXPECT_EQ(service->Handle(act).status, 200) << cookies;
    const std::string expired = service->security().ExpiredCookieHeader();
    EXPECT_TRUE(browser.contains(expired.substr(0, expired.find('=')))) << expired;
  }
}

TEST(Service, ReadsNeedTheTokenWhereOtherMachinesReachIt) {
  const auto service = MakeService({.token = kToken, .reads_need_token = true});
  auto request = Ask("192.168.0.7:8080");
  EXPECT_EQ(service.Handle(request).status, 401);
  EXPECT_TRUE(service.CheckSocket(request));
  request.authorization = fmt::format("Bearer {}", kToken);
  EXPECT_EQ(service.Handle(request).status, 200);
  EXPECT_FALSE(service.CheckSocket(request));
  auto sign_in = Ask("192.168.0.7:8080", "POST", "/api/v1/session");
  EXPECT_EQ(service.Handle(sign_in).status, 200) << "else nobody could bring it";
  auto page = Ask("192.168.0.7:8080", "GET", "/");
  EXPECT_EQ(service.Handle(page).status, 200) << "the page that asks for it";
}

TEST(Service, AnswersErrorsInsteadOfEnding) {
  const auto service = MakeService({});
  auto throws = Ask("localhost", "GET", "/throws");
  EXPECT_EQ(service.Handle(throws).status, 500);
  auto unknown = Ask("localhost", "GET", "/api/v1/none");
  EXPECT_EQ(service.Handle(unknown).status, 404);
  auto wrong = Ask("localhost", "POST", "/api/v1/home");
  const auto answer = service.Handle(wrong);
  EXPECT_EQ(answer.status, 405);
  ASSERT_FALSE(answer.headers.empty());
  EXPECT_EQ(answer.headers[0], std::pair(std::string("Allow"), std::string("GET")));
}

TEST(SecurityHeaders, AllowNoScriptOfOthersAndNoInlineOne) {
  const auto headers = SecurityHeaders("localhost:8080");
  const auto& policy = headers.at(0).second;
  EXPECT_NE(policy.find("default-src 'none'"), std::string::npos);
  EXPECT_EQ(policy.find("unsafe"), std::string::npos);
  EXPECT_NE(policy.find("ws://localhost:8080"), std::string::npos);
  EXPECT_EQ(SecurityHeaders("x; script-src *").at(0).second.find("script-src *"), std::string::npos);
}

}  // namespace security_test
}  // namespace etude::http
