// SPDX-License-Identifier: Apache-2.0
// Who may ask what. Closed by default: the address of this machine alone, names that are known, one token for actions.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "dashboard/server/http/message.h"

namespace etude::http {

struct SecurityConfig {
  /// Host names beside localhost and the bound addresses, lower case, without a port (--host).
  std::vector<std::string> hosts;
  std::string token;              ///< "": there are no actions
  bool reads_need_token = false;  ///< bound to more than this machine
};

/// Thread safety: const methods concurrent.
class Security {
 public:
  explicit Security(SecurityConfig config);

  /// nullopt: the request may go on. Host: a page of another name that resolves to this machine (DNS rebinding) is
  /// refused, whatever its Origin says. Origin: other pages may neither act nor open a WebSocket. Sec-Fetch-Site: nor
  /// ask the API anything. Sets request.authorized.
  /// @param changes  it is not a GET, or opens a WebSocket
  std::optional<Answer> Check(Request& request, bool changes) const;

  bool enabled() const { return !config_.token.empty(); }
  bool reads_need_token() const { return config_.reads_need_token; }
  /// In constant time.
  bool TokenMatches(std::string_view token) const;
  /// Value of the cookie of a browser that showed the token. @pre enabled()
  std::string CookieHeader() const;
  std::string ExpiredCookieHeader() const;

 private:
  bool HostAllowed(const Request& request) const;
  bool CookieMatches(const std::string& cookies) const;

  SecurityConfig config_;
  std::string session_;  // value of the cookie
  // A browser sends a host's cookies to all of its ports: two gateways on it must not sign each other out.
  std::string cookie_;  // its name
};

/// "[::1]:8080" -> "::1", "LocalHost:80" -> "localhost"; "" when it is not a host.
std::string HostName(std::string_view authority);

/// Headers of every answer. @param host  as the request named it, once it was allowed
std::vector<std::pair<std::string, std::string>> SecurityHeaders(const std::string& host);

}  // namespace etude::http
