// SPDX-License-Identifier: Apache-2.0
#include "services/core/identity.h"

#include <fmt/format.h>
#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <random>
#include <vector>

#include "services/core/clock.h"
#include "services/core/config.h"

namespace etude {
namespace {

constexpr std::size_t kIdDigits = 16;

Path FileOf(const Path& folder) { return folder / "identity.json"; }

bool AreHexDigits(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

}  // namespace

std::string NewId() {
  std::random_device device;
  return fmt::format("{:08x}{:08x}", device(), device());
}

bool IsId(std::string_view text) { return text.size() == kIdDigits && AreHexDigits(text); }

Result<Identity> ReadIdentity(const Path& folder) {
  ETUDE_ASSIGN_OR_RETURN(const std::string text, ReadTextFile(FileOf(folder), 1 << 16));
  const OrderedJson json = OrderedJson::parse(text, nullptr, false);
  Identity identity;
  if (json.is_object()) {
    identity.id = json.value("id", OrderedJson()).is_string() ? json["id"].get<std::string>() : "";
    if (json.contains("since") && json["since"].is_number_unsigned()) identity.since = json["since"];
  }
  if (IsId(identity.id)) return identity;
  return Fail(Code::kCorrupt, fmt::format("read '{}': not {{\"id\": 16 hexadecimal digits}}; --new-id makes a new one",
                                          FileOf(folder).string()));
}

Result<Identity> OpenIdentity(const Path& folder, Claim claim) {
  if (claim != Claim::kNewId) {
    auto identity = ReadIdentity(folder);
    if (identity || identity.error().code != Code::kNotFound) return identity;
  }
  const Identity minted{NewId(), static_cast<std::uint64_t>(WallSeconds())};
  const OrderedJson json{{"id", minted.id}, {"since", minted.since}};
  ETUDE_RETURN_IF_ERROR(WriteFileAtomically(FileOf(folder), json.dump() + "\n"));
  return minted;
}

Result<Selector> ParseSelector(std::string_view text, std::string_view what) {
  const std::size_t at = text.find('@');
  const Selector selector{std::string(text.substr(0, at)),
                          at == std::string_view::npos ? "" : std::string(text.substr(at + 1))};
  if (!IsPlainName(selector.name))
    return Fail(Code::kInvalidArgument, fmt::format("{} '{}': a name of a-z, 0-9, _ and -", what, text));
  const bool wrong_id = selector.id.empty() || selector.id.size() > kIdDigits || !AreHexDigits(selector.id);
  if (at != std::string_view::npos && wrong_id)
    return Fail(Code::kInvalidArgument, fmt::format("{} '{}': behind the @ the first digits of an id, e.g. {}@3f2a",
                                                    what, text, selector.name));
  return selector;
}

std::string HostName() {
  char name[256] = "unknown";
  ::gethostname(name, sizeof name - 1);
  return name;
}

std::string UserName() {
  passwd entry{};
  passwd* found = nullptr;
  std::vector<char> buffer(16 * 1024);
  ::getpwuid_r(::geteuid(), &entry, buffer.data(), buffer.size(), &found);
  return found ? found->pw_name : fmt::format("uid {}", ::geteuid());
}

}  // namespace etude
