// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/security.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "dashboard/server/http/answers.h"
#include "services/core/hash.h"

namespace etude::http {
namespace {

bool SameText(std::string_view first, std::string_view second) {
  // the time must not tell how many characters were right, so that hashes of equal length are compared
  const auto a = Sha256Hex(first), b = Sha256Hex(second);
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned>(a[i] ^ b[i]);
  return difference == 0;
}

bool IsHostCharacter(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_' || c == ':';
}

// "", ":8080"
bool IsPort(std::string_view text) {
  if (text.empty()) return true;
  return text.size() > 1 && text.size() <= 6 && text.front() == ':' &&
         std::ranges::all_of(text.substr(1), [](char c) { return c >= '0' && c <= '9'; });
}

}  // namespace

std::string HostName(std::string_view authority) {
  std::string_view name = authority;
  if (name.starts_with('[')) {
    const auto close = name.find(']');
    if (close == std::string_view::npos || !IsPort(name.substr(close + 1))) return "";
    name = name.substr(1, close - 1);
  } else if (const auto colon = name.rfind(':'); colon != std::string_view::npos) {
    if (!IsPort(name.substr(colon))) return "";
    name = name.substr(0, colon);
  }
  if (name.empty() || name.size() > 255 || !std::ranges::all_of(name, IsHostCharacter)) return "";
  std::string lower(name);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

Security::Security(SecurityConfig config) : config_(std::move(config)) {
  session_ = Sha256Hex("etude-gateway session " + config_.token);
  cookie_ = "etude_session_" + Sha256Hex(session_).substr(0, 8);
}

bool Security::TokenMatches(std::string_view token) const { return enabled() && SameText(token, config_.token); }

bool Security::CookieMatches(const std::string& cookies) const {
  std::string_view rest = cookies;
  while (!rest.empty()) {
    const auto end = rest.find(';');
    auto item = rest.substr(0, end);
    rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
    while (item.starts_with(' ')) item.remove_prefix(1);
    if (item.size() > cookie_.size() && item.starts_with(cookie_) && item[cookie_.size()] == '=' &&
        SameText(item.substr(cookie_.size() + 1), session_))
      return true;
  }
  return false;
}

std::string Security::CookieHeader() const {
  return fmt::format("{}={}; Path=/; HttpOnly; SameSite=Strict; Max-Age=604800", cookie_, session_);
}

std::string Security::ExpiredCookieHeader() const {
  return fmt::format("{}=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0", cookie_);
}

bool Security::HostAllowed(const Request& request) const {
  const std::string name = HostName(request.host);
  if (name.empty()) return false;
  if (name == "localhost" || name == "127.0.0.1" || name == "::1") return true;
  if (!request.local_address.empty() && name == request.local_address) return true;
  return std::ranges::find(config_.hosts, name) != config_.hosts.end();
}

std::optional<Answer> Security::Check(Request& request, bool changes) const {
  if (!HostAllowed(request)) {
    return Problem(403, "Unknown host",
                   fmt::format("Host '{:.100}' is not one that this gateway is known by", request.host),
                   "open it by its address, or start it with --host NAME");
  }
  if (changes && !request.origin.empty() && request.origin != "http://" + request.host &&
      request.origin != "https://" + request.host)
    return Problem(403, "Another page's request", fmt::format("Origin '{:.100}' is not this gateway", request.origin));
  // a GET has effects, too: pictures are rendered, videos made
  if ((request.fetch_site == "cross-site" || request.fetch_site == "same-site") && !request.path.empty() &&
      request.path[0] == "api")
    return Problem(403, "Another page's request", "a page of another origin asks (Sec-Fetch-Site)");
  constexpr std::string_view kBearer = "Bearer ";
  if (enabled())
    request.authorized = (request.authorization.starts_with(kBearer) &&
                          TokenMatches(std::string_view(request.authorization).substr(kBearer.size()))) ||
                         CookieMatches(request.cookie);
  return std::nullopt;
}

std::vector<std::pair<std::string, std::string>> SecurityHeaders(const std::string& host) {
  const std::string socket = HostName(host).empty() ? "" : fmt::format(" ws://{0} wss://{0}", host);  // with its port
  return {
      {"Content-Security-Policy",
       fmt::format("default-src 'none'; script-src 'self'; style-src 'self'; worker-src 'self'; img-src 'self' blob:; "
                   "media-src 'self'; connect-src 'self'{}; base-uri 'none'; form-action 'none'; "
                   "frame-ancestors 'none'",
                   socket)},
      {"X-Content-Type-Options", "nosniff"},
      {"X-Frame-Options", "DENY"},
      {"Referrer-Policy", "no-referrer"},
      {"Cross-Origin-Opener-Policy", "same-origin"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
      {"Permissions-Policy", "camera=(), microphone=(), geolocation=()"}};
}

}  // namespace etude::http
