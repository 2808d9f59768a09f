// SPDX-License-Identifier: Apache-2.0
#include "services/core/disk_wait.h"

#include <unistd.h>

#include <cerrno>

#include "services/core/clock.h"
#include "services/core/log.h"
#include "services/core/stop.h"

namespace etude {

Status WriteWhenThereIsRoom(const std::string& what, const std::function<Status()>& write,
                            std::chrono::milliseconds pause, const std::function<void()>& before_pause) {
  const Stopwatch waited;
  std::string said;
  while (true) {
    Status written = write();
    if (written && !said.empty()) Log().info("the disk took {} after {:.0f} s, going on", what, waited.Seconds());
    if (written || written.error().code != Code::kUnavailable || StopRequested()) return written;
    if (said != written.error().message)
      Log().error("waiting, nothing is lost: the disk does not take {}: {}", what, written.error().message);
    said = written.error().message;
    if (before_pause) before_pause();
    if (WaitForStop(pause)) return written;
  }
}

Status CheckMayWrite(const Path& folder) {
  if (::access(folder.c_str(), W_OK | X_OK) == 0 || errno != EACCES) return {};
  return Fail(ErrnoError("write into", folder, EACCES));
}

}  // namespace etude
