// SPDX-License-Identifier: Apache-2.0
// How the log is written; a header of its own, so that mains need not see the logger.
#pragma once

namespace etude {

/// Lines for people, or a JSON object each: {"time" (RFC 3339, UTC), "level", "source", "pid", "code", "text"}.
enum class LogFormat { kText, kJson };

/// Before InitLog, e.g. from `--log json`; the default is text.
void SetLogFormat(LogFormat format);
LogFormat GetLogFormat();

}  // namespace etude
