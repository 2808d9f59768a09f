// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <exception>

#include "dashboard/server/http/answers.h"
#include "dashboard/server/http/encoding.h"

namespace etude::http {
namespace {

Answer Unauthorized(const Security& security) {
  if (!security.enabled())
    return Problem(403, "No actions", "this gateway was started without a token, so that nothing can be changed",
                   "etude dashboard --token-file FILE");
  Answer answer = Problem(401, "The token is needed", "this request did not bring the gateway's token",
                          "sign in, or send Authorization: Bearer TOKEN");
  answer.headers.emplace_back("WWW-Authenticate", "Bearer");
  return answer;
}

Answer FromResult(Result<Answer> result) { return result ? std::move(*result) : ProblemOf(result.error()); }

bool IsRead(const Request& request) { return request.method == "GET" || request.method == "HEAD"; }

}  // namespace

Lane Service::LaneOf(Request& request) const {
  std::vector<std::string> allowed;
  const auto* route = router_.Find(request, allowed);
  return route ? route->lane : Lane::kFiles;
}

Answer Service::Route(Request& request) const {
  std::vector<std::string> allowed;
  const http::Route* route = router_.Find(request, allowed);
  const Access access = route ? route->access : Access::kRead;
  if (access != Access::kPublic)
    if (auto refused = security_.Check(request, !IsRead(request))) return std::move(*refused);
  if (!route) {
    if (!allowed.empty()) {
      Answer answer = Problem(405, "Not that way", fmt::format("{} does not apply to this address", request.method));
      answer.headers.emplace_back("Allow", fmt::format("{}", fmt::join(allowed, ", ")));
      return answer;
    }
    const bool api = !request.path.empty() && request.path[0] == "api";
    if (api || !IsRead(request)) return Problem(404, "Not found", "there is no such address", "/api/v1/openapi.json");
    return FromResult(pages_(request));
  }
  const bool token = access == Access::kAction || (access == Access::kRead && security_.reads_need_token());
  if (token && !request.authorized) return Unauthorized(security_);
  return FromResult(route->handler(request));
}

Answer Service::Handle(Request& request) const {
  Answer answer;
  try {
    answer = Route(request);
    Finish(request, answer);
  } catch (const std::exception& error) {
    // what a library throws past its owner must not end the gateway
    answer = Problem(500, "Failed", error.what());
  }
  return answer;
}

std::optional<Answer> Service::CheckSocket(Request& request) const {
  if (auto refused = security_.Check(request, true)) return refused;
  if (security_.reads_need_token() && !request.authorized) return Unauthorized(security_);
  return std::nullopt;
}

}  // namespace etude::http
