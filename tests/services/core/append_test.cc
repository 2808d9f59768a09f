// SPDX-License-Identifier: Apache-2.0
#include "services/core/append.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string_view>

#include "services/core/descriptor.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude {
namespace append_test {

Status Append(int fd, const Path& path, std::string_view text) {
  return AppendWhole(fd, path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

TEST(AppendWhole, CutsAwayAPartThatDidNotFit) {
  const TemporaryFolder folder;
  const Path path = folder / "records";
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);
    const Descriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644));
    const bool first = Append(file.get(), path, "12345").has_value();
    ::rlimit limit{};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 8;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const bool second = Append(file.get(), path, "abcdef").has_value();
    limit.rlim_cur = limit.rlim_max;
    ::setrlimit(RLIMIT_FSIZE, &limit);
    const bool third = Append(file.get(), path, "xyz").has_value();
    ::_exit(first && !second && third ? 0 : 1);
  }
  int wait_status = 0;
  ASSERT_EQ(::waitpid(child, &wait_status, 0), child);
  EXPECT_EQ(wait_status, 0);
  EXPECT_EQ(ReadTextFile(path).value(), "12345xyz");
}

TEST(AppendWhole, SaysWhichFileItCouldNotWrite) {
  const TemporaryFolder folder;
  EXPECT_THAT(Append(-1, folder / "gone", "x"), MessageHas((folder / "gone").string()));

  ASSERT_THAT(WriteFileAtomically(folder / "kept", "as it was"), IsOk());
  const Descriptor reading(::open((folder / "kept").c_str(), O_RDONLY | O_CLOEXEC));
  EXPECT_THAT(Append(reading.get(), folder / "kept", "x"), MessageHas((folder / "kept").string()));
  EXPECT_EQ(ReadTextFile(folder / "kept").value(), "as it was");
}

}  // namespace append_test
}  // namespace etude
