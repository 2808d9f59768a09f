// SPDX-License-Identifier: Apache-2.0
// One line of progress on stderr: rewritten in place on a terminal, every few seconds elsewhere; of the log where that
// is for programs.
#pragma once

#include <string>

#include "services/core/clock.h"

namespace etude {

/// One at a time in a process. What is logged meanwhile takes the place of the line, which Show draws again below it.
/// Not thread-safe; the log is.
class ProgressDisplay {
 public:
  ProgressDisplay();
  /// Ends the line.
  ~ProgressDisplay();
  ProgressDisplay(const ProgressDisplay&) = delete;
  ProgressDisplay& operator=(const ProgressDisplay&) = delete;

  /// Whether the line is rewritten in place: stderr is a terminal, and the log is for people.
  bool in_place() const { return in_place_; }
  /// True when a new line is wanted; so that it is only made when it is shown.
  bool due() const;
  /// @param line  without its end; what a terminal has no room for is left out
  void Show(const std::string& line);
  /// Something to keep: on a line of its own.
  void Say(const std::string& line);

 private:
  const bool in_place_;
  MonotonicClock::time_point shown_{};
};

namespace internal {
/// Takes a line of progress that stands open off the terminal. Any thread.
void ClearProgress();
}  // namespace internal

}  // namespace etude
