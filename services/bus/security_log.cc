// SPDX-License-Identifier: Apache-2.0
#include "services/bus/security_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace etude::bus {
namespace {

struct Pattern {
  const char* part;    // of the library's text
  const char* reason;  // ours
  const char* advice;
};

// The first that fits counts.
constexpr Pattern kPatterns[] = {
    {"unable to get local issuer certificate", "unknown authority",
     "its certificate is of another authority (etude security init); issue it an identity of this one"},
    // two authorities call themselves alike, so that the other one's key is tried
    {"certificate signature failure", "unknown authority",
     "its certificate is of another authority (etude security init); issue it an identity of this one"},
    {"self-signed certificate", "unknown permissions authority",
     "its permissions are of another authority; issue it an identity of this one"},
    {"self signed certificate", "unknown permissions authority",
     "its permissions are of another authority; issue it an identity of this one"},
    {"certificate revoked", "revoked", "its certificate was revoked"},
    {"certificate has expired", "expired", "the certificate expired; issue it again"},
    {"certificate is not yet valid", "not yet valid", "the certificate does not hold yet: check the clocks"},
    {"CRL has expired", "revocation list out of date", "crl.pem is out of date; make a new one"},
    {"Permissions validity period expired", "permissions expired", "the permissions expired; issue them again"},
    {"Subject name is invalid", "foreign permissions", "the permissions are of another name; copy the whole folder"},
    {"digest failure", "altered document", "a signed document was altered; copy the whole folder again"},
    {"denied by default rule", "not permitted", "its role does not allow that; see services/bus/access.h"},
    {"does not allow remote", "not permitted", "its role does not allow that; see services/bus/access.h"},
    {"Not Allowed By Security", "not permitted", "its role does not allow that"},
    {"security_attributes mismatch", "other governance", "the two have different governance.p7s; copy the authority's"},
    {"Timed out", "handshake timed out", "it did not finish its handshake"},
    {"handshake", "handshake failed", "it was not admitted"},
};

// A discovery message came before our own participant was there; the next one is taken.
constexpr const char* kHarmless[] = {"Remote secure participant"};

bool Holds(std::string_view text, std::string_view part) { return text.find(part) != std::string_view::npos; }

// The value after `key` up to a separator.
std::string After(std::string_view text, std::string_view key, std::string_view ends) {
  const auto at = text.find(key);
  if (at == std::string_view::npos) return "";
  const auto begin = at + key.size();
  const auto end = std::min(text.find_first_of(ends, begin), text.size());
  return std::string(text.substr(begin, end - begin));
}

// "110fa2b:c3d4:e5f6:1c1": four groups of hexadecimal digits.
std::string GuidIn(std::string_view text) {
  for (std::size_t begin = 0; begin < text.size();) {
    const auto is_part = [&](char c) { return std::isxdigit(static_cast<unsigned char>(c)) != 0 || c == ':'; };
    auto end = begin;
    while (end < text.size() && is_part(text[end])) ++end;
    const auto word = text.substr(begin, end - begin);
    if (std::ranges::count(word, ':') == 3 && word.size() >= 10) return std::string(word);
    begin = end + 1;
  }
  return "";
}

std::string PeerIn(std::string_view text) {
  if (auto name = After(text, "/CN=", "/,;( "); !name.empty()) return name;
  if (auto name = After(text, "CN=", "/,;( "); !name.empty()) return name;
  return GuidIn(text);
}

}  // namespace

std::optional<SecurityLine> TranslateSecurity(std::string_view text) {
  for (const char* harmless : kHarmless)
    if (Holds(text, harmless)) return SecurityLine{"harmless", "", ""};
  for (const auto& [part, reason, advice] : kPatterns) {
    if (!Holds(text, part)) continue;
    const std::string peer = PeerIn(text);
    return SecurityLine{
        reason, peer,
        fmt::format("security: {}{}: {} ({})", peer.empty() ? "" : "'" + peer + "' ", reason, advice, text)};
  }
  return std::nullopt;
}

std::optional<std::string> SecurityLines::Take(const SecurityLine& line) {
  if (line.text.empty()) return std::nullopt;
  const MutexLock lock(mutex_);
  // strangers choose their names: they must not silence what is said of others for ever
  if (said_.size() >= kMostPeers) said_.clear();
  if (!said_.insert(line.reason + "\n" + line.peer).second) return std::nullopt;
  return line.text;
}

}  // namespace etude::bus
