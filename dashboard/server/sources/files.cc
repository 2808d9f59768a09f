// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/sources/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <ctime>
#include <vector>

#include "services/core/growing_file.h"
#include "services/episode/bounded_json.h"

namespace etude::sources {
namespace {

constexpr std::size_t kReadChunk = 1 << 20;
constexpr std::size_t kLongestLine = 1 << 20;  // bytes; a longer one is no line of ours

FileStamp StampFrom(const struct stat& status) {
  if (!S_ISREG(status.st_mode)) return {};
  return {static_cast<std::uint64_t>(status.st_dev), static_cast<std::uint64_t>(status.st_ino),
          static_cast<std::uint64_t>(status.st_size),
          static_cast<std::int64_t>(status.st_mtim.tv_sec) * 1'000'000'000 + status.st_mtim.tv_nsec};
}

}  // namespace

std::string FileStamp::tag() const { return fmt::format("{:x}-{:x}-{:x}-{:x}", device, inode, size, modified_ns); }

FileStamp StampOf(const Path& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 ? StampFrom(status) : FileStamp{};
}

Result<ConfinedFile> OpenBelow(const Path& folder, const Path& relative) {
  const auto outside = [&] {
    return Fail(Code::kInvalidArgument, fmt::format("'{}' is not a name below the folder", relative.string()));
  };
  std::vector<std::string> steps;
  for (const auto& step : relative) {
    if (step == ".." || step == "." || step.empty() || step.has_root_path()) return outside();
    steps.push_back(step.string());
  }
  if (steps.empty()) return outside();
  Descriptor at{::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  for (std::size_t i = 0; i < steps.size() && at; ++i) {
    const int kind = i + 1 < steps.size() ? O_DIRECTORY : O_NONBLOCK;
    at = Descriptor(::openat(at.get(), steps[i].c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | kind));
  }
  struct stat status {};
  if (!at || ::fstat(at.get(), &status) != 0 || !S_ISREG(status.st_mode))
    return Fail(Code::kNotFound, fmt::format("there is no file '{}'", relative.string()));
  return ConfinedFile{std::move(at), StampFrom(status)};
}

void JsonLines::Refresh(const std::function<void()>& reset, const std::function<void(const OrderedJson&)>& line) {
  const FileStamp now = StampOf(path_);
  if (now == stamp_) return;
  const Descriptor file{::open(path_.c_str(), O_RDONLY | O_CLOEXEC)};
  if (now.exists() && !file) return;  // no descriptor is left, say: what was read stays, and it is asked for again
  if (now.inode != stamp_.inode || now.device != stamp_.device || BytesBefore(file.get(), offset_) != before_) {
    reset();
    offset_ = 0;
  }
  stamp_ = now;
  std::string text;
  std::vector<char> chunk(kReadChunk);
  for (std::uint64_t at = offset_; file;) {
    const auto got = ::pread(file.get(), chunk.data(), chunk.size(), static_cast<off_t>(at));
    if (got <= 0) break;
    at += static_cast<std::uint64_t>(got);
    text.append(chunk.data(), static_cast<std::size_t>(got));
    std::size_t begin = 0;
    for (std::size_t end; (end = text.find('\n', begin)) != std::string::npos; begin = end + 1) {
      const auto parsed = ParseBoundedJson(std::string_view(text).substr(begin, end - begin));
      if (parsed && parsed->is_object()) line(*parsed);
    }
    offset_ += begin;
    text.erase(0, begin);
    if (text.size() > kLongestLine) {  // passed over; so is its end
      offset_ += text.size();
      text.clear();
    }
  }
  torn_ = !text.empty();
  before_ = BytesBefore(file.get(), offset_);
}

std::string Rfc3339(double seconds) {
  if (!std::isfinite(seconds)) seconds = 0;
  const auto milliseconds = static_cast<std::int64_t>(std::llround(seconds * 1000));
  const std::time_t whole = static_cast<std::time_t>(milliseconds / 1000);
  std::tm parts{};
  ::gmtime_r(&whole, &parts);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z", parts.tm_year + 1900, parts.tm_mon + 1,
                     parts.tm_mday, parts.tm_hour, parts.tm_min, parts.tm_sec, milliseconds % 1000);
}

std::optional<double> ParseTime(const std::string& text) {
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error == std::errc() && end == text.data() + text.size() && std::isfinite(number)) return number;
  std::tm parts{};
  const char* rest = ::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &parts);
  if (!rest) return std::nullopt;
  double fraction = 0;
  if (*rest == '.') {
    const auto [after, bad] = std::from_chars(rest, text.c_str() + text.size(), fraction);
    if (bad != std::errc()) return std::nullopt;
    rest = after;
  }
  if (std::string_view(rest) != "Z" && !std::string_view(rest).empty()) return std::nullopt;
  return static_cast<double>(::timegm(&parts)) + fraction;
}

OrderedJson TimeJson(std::optional<double> seconds) {
  return seconds && *seconds > 0 ? OrderedJson(Rfc3339(*seconds)) : OrderedJson();
}

const OrderedJson& PartOf(const OrderedJson& json, const char* key) {
  static const OrderedJson nothing;
  if (!json.is_object()) return nothing;
  const auto found = json.find(key);
  return found == json.end() ? nothing : *found;
}

std::string TextOf(const OrderedJson& json, const char* key, const std::string& fallback) {
  const auto& part = PartOf(json, key);
  return part.is_string() ? part.get<std::string>() : fallback;
}

std::optional<double> NumberOf(const OrderedJson& json, const char* key) {
  const auto& part = PartOf(json, key);
  if (!part.is_number() || !std::isfinite(part.get<double>())) return std::nullopt;
  return part.get<double>();
}

std::optional<std::uint64_t> UnsignedOf(const OrderedJson& json, const char* key) {
  const auto& part = PartOf(json, key);
  if (part.is_number_unsigned()) return part.get<std::uint64_t>();
  if (part.is_number_integer() && part.get<std::int64_t>() >= 0)
    return static_cast<std::uint64_t>(part.get<std::int64_t>());
  return std::nullopt;
}

bool FlagOf(const OrderedJson& json, const char* key) { return PartOf(json, key) == true; }

}  // namespace etude::sources
