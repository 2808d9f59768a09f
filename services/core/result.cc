// SPDX-License-Identifier: Apache-2.0
#include "services/core/result.h"

namespace etude {

std::string_view ToString(Code code) {
  switch (code) {
    case Code::kInvalidArgument:
      return "invalid argument";
    case Code::kNotFound:
      return "not found";
    case Code::kUnavailable:
      return "unavailable";
    case Code::kTimeout:
      return "timeout";
    case Code::kExhausted:
      return "exhausted";
    case Code::kCorrupt:
      return "corrupt";
    case Code::kInternal:
      return "internal error";
  }
  return "unknown";
}

// (not inline: GCC 12 warns of std::string's operator+ where it inlines it into some callers)
Error Error::Wrap(std::string_view context) const {
  std::string text(context);
  text.append(": ").append(message);
  return {code, std::move(text)};
}

}  // namespace etude
