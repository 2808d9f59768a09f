// SPDX-License-Identifier: Apache-2.0
// Exceptions of libraries end here, as errors with their words.
#pragma once

#include <exception>
#include <functional>
#include <string>

#include "services/core/result.h"

namespace etude {

/// What `body` returns; kInternal with the words of what it throws. For the bodies of threads: nobody is above them,
/// and an exception would end the program without words.
inline Status WithoutThrowing(const std::function<Status()>& body) {
  try {
    return body();
  } catch (const std::exception& error) {
    return Fail(Code::kInternal, std::string("an exception: ") + error.what());
  } catch (...) {
    return Fail(Code::kInternal, "an exception of an unknown type");
  }
}

}  // namespace etude
