// SPDX-License-Identifier: Apache-2.0
// A command of the shell and what it prints: for tests that ask readers which are not ours.
#pragma once

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <string>

namespace etude {

struct ShellOutput {
  int code = -1;  ///< 127: no such command
  std::string text;
};

inline ShellOutput RunInShell(const std::string& command) {
  ShellOutput output;
  FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return output;
  std::array<char, 4096> buffer;
  for (std::size_t got; (got = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    output.text.append(buffer.data(), got);
  const int status = ::pclose(pipe);
  output.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return output;
}

}  // namespace etude
