// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/router.h"

#include <utility>

#include "services/core/check.h"

namespace etude::http {

void Router::Add(std::string method, std::string pattern, Lane lane, Handler handler, Access access) {
  std::vector<Segment> segments;
  std::string_view rest = pattern;
  while (!rest.empty()) {
    const auto slash = rest.find('/');
    const std::string text(rest.substr(0, slash));
    rest = slash == std::string_view::npos ? std::string_view() : rest.substr(slash + 1);
    if (text.empty()) continue;
    const auto open = text.find('{'), close = text.find('}');
    if (open == std::string::npos) {
      segments.push_back({text, "", ""});
      continue;
    }
    ETUDE_CHECK(close != std::string::npos && close > open + 1, "route {}", pattern);
    segments.push_back({text.substr(0, open), text.substr(open + 1, close - open - 1), text.substr(close + 1)});
  }
  routes_.push_back({std::move(method), std::move(pattern), lane, std::move(handler), access});
  segments_.push_back(std::move(segments));
}

bool Router::Match(const std::vector<Segment>& segments, Request& request) {
  if (segments.size() != request.path.size()) return false;
  std::map<std::string, std::string> parameters;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const auto& [prefix, name, suffix] = segments[i];
    const std::string& text = request.path[i];
    if (name.empty()) {
      if (text != prefix) return false;
      continue;
    }
    if (text.size() <= prefix.size() + suffix.size() || !text.starts_with(prefix) || !text.ends_with(suffix))
      return false;
    parameters[name] = text.substr(prefix.size(), text.size() - prefix.size() - suffix.size());
  }
  request.parameters = std::move(parameters);
  return true;
}

const Route* Router::Find(Request& request, std::vector<std::string>& allowed) const {
  const std::string method = request.method == "HEAD" ? "GET" : request.method;
  for (std::size_t i = 0; i < routes_.size(); ++i) {
    if (!Match(segments_[i], request)) continue;
    if (routes_[i].method == method) return &routes_[i];
    allowed.push_back(routes_[i].method);
  }
  return nullptr;
}

}  // namespace etude::http
