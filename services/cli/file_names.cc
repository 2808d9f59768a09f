// SPDX-License-Identifier: Apache-2.0
#include "services/cli/file_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "services/core/file.h"

namespace etude::cli {
namespace {

constexpr std::size_t kMaxWord = 64;

std::string FileWord(const std::string& text) {
  std::string word = text.substr(0, kMaxWord);
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '+' ||
           c == '-';
  };
  std::replace_if(
      word.begin(), word.end(), [&](char c) { return !fits(c); }, '_');
  return word;
}

}  // namespace

Result<std::string> CheckpointFileName(const std::string& channel, std::uint64_t version) {
  if (!IsPlainName(channel))
    return Fail(Code::kInvalidArgument,
                fmt::format("a publisher calls its channel '{}', which is no name of a-z, 0-9, _ and -",
                            channel.substr(0, kMaxWord)));
  return fmt::format("{}-{:08}.safetensors", channel, version);
}

std::string VideoFileName(std::uint64_t index, const std::string& task, const std::string& outcome) {
  return fmt::format("{:06}-{}-{}.mp4", index, FileWord(task), FileWord(outcome));
}

bool IsMadeOf(const Path& derived, const Path& source) {
  std::error_code missing;
  const auto made = std::filesystem::last_write_time(derived, missing);
  if (missing) return false;
  const auto of = std::filesystem::last_write_time(source, missing);
  return !missing && made >= of;
}

}  // namespace etude::cli
