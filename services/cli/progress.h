// SPDX-License-Identifier: Apache-2.0
// One line of progress on stderr: rewritten in place on a terminal, every few seconds elsewhere.
#pragma once

#include <string>

#include "services/core/clock.h"

namespace etude::cli {

class ProgressDisplay {
 public:
  ProgressDisplay();
  /// Ends the line.
  ~ProgressDisplay();
  ProgressDisplay(const ProgressDisplay&) = delete;
  ProgressDisplay& operator=(const ProgressDisplay&) = delete;

  /// True when a new line is wanted; so that it is only made when it is shown.
  bool due() const;
  void Show(const std::string& line);
  /// Something to keep: on a line of its own.
  void Say(const std::string& line);

 private:
  bool terminal_;
  bool open_ = false;  // a line without its end stands on the terminal
  MonotonicClock::time_point shown_{};
};

}  // namespace etude::cli
