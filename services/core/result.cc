// SPDX-License-Identifier: Apache-2.0
#include "services/core/result.h"

#include "services/core/enum_name.h"

namespace etude {

std::string_view ToString(Code code) {
  return EnumName(code,
                  {{Code::kInvalidArgument, "invalid argument"},
                   {Code::kNotFound, "not found"},
                   {Code::kUnavailable, "unavailable"},
                   {Code::kTimeout, "timeout"},
                   {Code::kExhausted, "exhausted"},
                   {Code::kCorrupt, "corrupt"},
                   {Code::kInternal, "internal error"}},
                  "unknown");
}

// (not inline: GCC 12 warns of std::string's operator+ where it inlines it into some callers)
Error Error::Wrap(std::string_view context) const {
  std::string text(context);
  text.append(": ").append(message);
  return {code, std::move(text)};
}

}  // namespace etude
