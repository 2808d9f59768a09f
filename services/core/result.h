// SPDX-License-Identifier: Apache-2.0
// Errors as values: Error, Status and Result<T>.
//
// An *outcome* such as "no path" is not an error: it is a value of the function's own type. An Error
// is an expected failure (a bad file, a full disk, a peer that went away); a bug is ETUDE_CHECK.
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>

namespace etude {

/// What kind of failure; decides the exit code of a command (see ExitCode in core/command.h).
enum class Code {
  kInvalidArgument,  ///< the caller's input is wrong: a key, a flag, a shape (exit 2)
  kNotFound,         ///< the named thing does not exist
  kUnavailable,      ///< the machine or a peer cannot serve: no GL, no DDS, disk full (exit 3)
  kTimeout,          ///< nothing happened within the stated time
  kExhausted,        ///< a stated bound was reached
  kCorrupt,          ///< bytes are not what they claim to be
  kInternal,         ///< a library failed in a way that we do not know
};

/// `invalid argument`, `not found`, ...
std::string_view ToString(Code code);

/// A failure: what was attempted, with which values, and what to do. Never empty.
struct Error {
  Code code = Code::kInternal;
  std::string message;

  /// The same error with `context` put in front: "context: message".
  Error Wrap(std::string_view context) const;
};

/// A T or an Error. Dropping one is a compiler warning (and warnings are errors here).
template <class T>
class [[nodiscard]] Result : public tl::expected<T, Error> {
 public:
  using tl::expected<T, Error>::expected;
};

/// Success or an Error.
using Status = Result<void>;

/// Makes the error branch of a Result: `return Fail(Code::kCorrupt, fmt::format(...));`
inline tl::unexpected<Error> Fail(Code code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}
inline tl::unexpected<Error> Fail(Error error) { return tl::unexpected<Error>(std::move(error)); }

}  // namespace etude

#define ETUDE_CONCAT_INNER(a, b) a##b
#define ETUDE_CONCAT(a, b) ETUDE_CONCAT_INNER(a, b)

/// Returns the error of a Status (or Result) to the caller: `ETUDE_RETURN_IF_ERROR(file.Sync());`
#define ETUDE_RETURN_IF_ERROR(expr)                                           \
  do {                                                                        \
    auto etude_status = (expr);                                               \
    if (!etude_status) return ::etude::Fail(std::move(etude_status).error()); \
  } while (false)

/// Assigns the value or returns the error: `ETUDE_ASSIGN_OR_RETURN(auto spec, ReadSpec(path));`
#define ETUDE_ASSIGN_OR_RETURN(lhs, expr) ETUDE_ASSIGN_OR_RETURN_IMPL(ETUDE_CONCAT(etude_result_, __LINE__), lhs, expr)
#define ETUDE_ASSIGN_OR_RETURN_IMPL(result, lhs, expr)          \
  auto result = (expr);                                         \
  if (!result) return ::etude::Fail(std::move(result).error()); \
  lhs = std::move(*result)
