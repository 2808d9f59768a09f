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

}  // namespace etude
