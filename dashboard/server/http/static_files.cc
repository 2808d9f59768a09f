// SPDX-License-Identifier: Apache-2.0
#include "dashboard/server/http/static_files.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <utility>

#include "dashboard/server/http/answers.h"
#include "dashboard/server/http/encoding.h"

namespace etude::http {
namespace {

constexpr std::uint64_t kMostBytes = 16 << 20;  // of one file
constexpr std::size_t kMostFiles = 2000;
constexpr std::chrono::seconds kScanEvery{2};

constexpr std::array<std::pair<std::string_view, std::string_view>, 13> kTypes{
    {{".html", "text/html; charset=utf-8"},
     {".js", "text/javascript; charset=utf-8"},
     {".css", "text/css; charset=utf-8"},
     {".json", "application/json"},
     {".svg", "image/svg+xml"},
     {".png", "image/png"},
     {".webp", "image/webp"},
     {".ico", "image/x-icon"},
     {".txt", "text/plain; charset=utf-8"},
     {".csv", "text/csv; charset=utf-8"},
     {".mp4", "video/mp4"},
     {".woff2", "font/woff2"},
     {".safetensors", "application/vnd.safetensors"}}};

// "main-TTGKP5R6.js": the bundler put a hash of the content into its name
bool NamesItsContent(const std::string& name) {
  constexpr std::size_t kHash = 8;
  const auto dot = name.rfind('.');
  if (dot == std::string::npos || dot < kHash + 2 || name[dot - kHash - 1] != '-') return false;
  return std::all_of(name.begin() + static_cast<std::ptrdiff_t>(dot - kHash),
                     name.begin() + static_cast<std::ptrdiff_t>(dot),
                     [](unsigned char c) { return std::isupper(c) || std::isdigit(c); });
}

Answer NotBuilt(const Path& folder) {
  Answer answer = BytesAnswer(
      fmt::format("The pages are not built: there is no index.html in {}.\nBuild them with `npm ci && ./build` in "
                  "dashboard/web. The API is there: /api/v1/openapi.json\n",
                  folder.string()),
      "text/plain; charset=utf-8", Caching::kNever);
  answer.status = 503;
  return answer;
}

}  // namespace

std::string ContentTypeOf(const std::string& name) {
  for (const auto& [ending, type] : kTypes)
    if (name.ends_with(ending)) return std::string(type);
  return "application/octet-stream";
}

void StaticFiles::Scan() {
  if (MonotonicClock::now() - scanned_ < kScanEvery) return;
  scanned_ = MonotonicClock::now();
  std::map<std::string, File> found;
  std::error_code error;
  std::filesystem::recursive_directory_iterator entries(folder_, error), end;
  for (; !error && entries != end && found.size() < kMostFiles; entries.increment(error)) {
    const auto& entry = *entries;
    if (!entry.is_regular_file(error) || entry.is_symlink(error) || entry.file_size(error) > kMostBytes) continue;
    const std::string name = entry.path().lexically_relative(folder_).generic_string();
    const std::string tag =
        fmt::format("{:x}-{:x}", entry.file_size(error), entry.last_write_time(error).time_since_epoch().count());
    File file{entry.path(), tag, nullptr};
    if (const auto old = files_.find(name); old != files_.end() && old->second.tag == tag) file = old->second;
    found.emplace(name, std::move(file));
  }
  files_ = std::move(found);
}

const StaticFiles::File* StaticFiles::Load(const std::string& name) {
  const auto found = files_.find(name);
  if (found == files_.end()) return nullptr;
  if (!found->second.content) {
    auto text = ReadTextFile(found->second.path, kMostBytes);
    if (!text) return nullptr;
    found->second.content = std::make_shared<const std::string>(std::move(*text));
  }
  return &found->second;
}

Result<Answer> StaticFiles::Serve(const Request& request) {
  std::string name = fmt::format("{}", fmt::join(request.path, "/"));
  MutexLock lock(mutex_);
  Scan();
  const bool page = request.path.empty() || request.path.back().find('.') == std::string::npos;
  if (page && !files_.contains(name)) name = "index.html";
  if (!files_.contains("index.html")) return NotBuilt(folder_);
  const bool compressed = files_.contains(name + ".gz") && Accepts(request.accept_encoding, "gzip");
  const File* file = Load(compressed ? name + ".gz" : name);
  if (!file) return Fail(Code::kNotFound, fmt::format("'{:.100}' is not one of the pages' files", name));
  Answer answer = BytesAnswer(*file->content, ContentTypeOf(name),
                              NamesItsContent(name) ? Caching::kImmutable : Caching::kRevalidate);
  answer.etag = file->tag + (compressed ? "-z" : "");
  if (compressed) answer.content_encoding = "gzip";
  return answer;
}

}  // namespace etude::http
