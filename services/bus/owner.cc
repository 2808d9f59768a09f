// SPDX-License-Identifier: Apache-2.0
#include "services/bus/owner.h"

#include <fmt/format.h>

namespace etude::bus {
namespace {

constexpr std::string_view kSeparator = "--";
constexpr std::size_t kDigits = 8;
constexpr std::size_t kLongest = 64;  // IsPlainName

}  // namespace

std::string AddressOnHost(const std::string& host, std::uint32_t process) {
  constexpr std::size_t kMost = kLongest - kSeparator.size() - kDigits;
  // generated names differ at their ends
  const std::size_t begin = host.size() > kMost ? host.size() - kMost : 0;
  return fmt::format("{}{}{:0{}x}", host.substr(begin), kSeparator, process, kDigits);
}

std::string HostOfAddress(const std::string& address) {
  const std::size_t tail = kSeparator.size() + kDigits;
  if (address.size() <= tail) return address;
  const std::string_view end = std::string_view(address).substr(address.size() - tail);
  const bool is_process = end.starts_with(kSeparator) &&
                          end.find_first_not_of("0123456789abcdef", kSeparator.size()) == std::string_view::npos;
  return is_process ? address.substr(0, address.size() - tail) : address;
}

}  // namespace etude::bus
