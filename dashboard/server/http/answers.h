// SPDX-License-Identifier: Apache-2.0
// Answers of the usual kinds: JSON, bytes, and errors as problem+json (RFC 9457).
#pragma once

#include <string>

#include "dashboard/server/http/message.h"
#include "services/core/config.h"

namespace etude::http {

/// Integers that JavaScript cannot hold (beyond 2^53) and every key named "seed" become strings, numbers that are not
/// finite become null. Applied to whatever another process wrote.
OrderedJson ForBrowsers(const OrderedJson& json);

/// `json` as it is: pass what others wrote through ForBrowsers.
Answer JsonAnswer(const OrderedJson& json, int status = 200);
Answer BytesAnswer(std::string bytes, std::string content_type, Caching caching = Caching::kRevalidate);

/// {title, status, detail, hint}
Answer Problem(int status, std::string_view title, std::string_view detail, std::string_view hint = "");
/// Not found 404, invalid argument 400, exhausted 413, unavailable 503, timeout 504, corrupt 422, else 500.
Answer ProblemOf(const Error& error);

}  // namespace etude::http
