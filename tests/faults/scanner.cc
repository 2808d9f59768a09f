// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/scanner.h"

#include <fmt/format.h>
#include <openssl/sha.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <charconv>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <string_view>

namespace etude::faults {
namespace {

constexpr std::string_view kSealBegins = "\nETUDE-SEAL ";
constexpr std::size_t kHashDigits = 64;

std::string HexSha256(std::span<const std::uint8_t> bytes) {
  std::uint8_t digest[SHA256_DIGEST_LENGTH];
  ::SHA256(bytes.data(), bytes.size(), digest);
  std::string text;
  for (const std::uint8_t byte : digest) text += fmt::format("{:02x}", byte);
  return text;
}

std::string_view AsText(std::span<const std::uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// The last line is a seal that says what all before it is.
bool IsWhole(std::span<const std::uint8_t> bytes) {
  const std::string_view text = AsText(bytes);
  if (!text.starts_with("\x89HDF\r\n\x1a\n")) return false;
  const auto at = text.rfind(kSealBegins);
  if (at == std::string_view::npos || !text.ends_with('\n')) return false;
  const std::string_view seal = text.substr(at);
  const bool one_line = seal.find('\n', 1) == seal.size() - 1;
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), at);
  return one_line && seal.find(fmt::format("crc32={:08x}", crc.checksum())) != std::string_view::npos &&
         seal.find(std::to_string(at)) != std::string_view::npos;
}

// "demo_12" and no further digit
bool Names(std::string_view text, std::uint64_t index) {
  const std::string name = fmt::format("demo_{}", index);
  for (auto at = text.find(name); at != std::string_view::npos; at = text.find(name, at + 1)) {
    const std::size_t end = at + name.size();
    if (end == text.size() || text[end] < '0' || text[end] > '9') return true;
  }
  return false;
}

// Every run of 64 hexadecimal digits: what lies around a text in a binary file may look like more of them.
std::set<std::string> HashesIn(std::string_view text) {
  std::set<std::string> hashes;
  std::size_t run = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool digit = (text[i] >= '0' && text[i] <= '9') || (text[i] >= 'a' && text[i] <= 'f');
    run = digit ? run + 1 : 0;
    if (run >= kHashDigits) hashes.emplace(text.substr(i + 1 - kHashDigits, kHashDigits));
  }
  return hashes;
}

// episodes/000/000012.hdf5 -> 12. Nothing for temporary files; another name is an index that nobody has.
std::optional<std::uint64_t> IndexOf(const std::string& name) {
  const std::filesystem::path path(name);
  if (path.extension() != ".hdf5") return std::nullopt;
  const std::string stem = path.stem().string();
  std::uint64_t index = 0;
  const auto [end, error] = std::from_chars(stem.data(), stem.data() + stem.size(), index);
  if (error != std::errc() || end != stem.data() + stem.size()) return std::nullopt;
  return index;
}

std::vector<std::uint8_t> ReadAll(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Every file below FOLDER/episodes, with its name below FOLDER.
template <class Visit>
void ForEachEpisode(const std::filesystem::path& dataset, const Visit& visit) {
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator it(dataset / "episodes", error), end; !error && it != end;
       it.increment(error))
    if (it->is_regular_file(error)) visit(it->path().lexically_relative(dataset).string(), ReadAll(it->path()));
}

}  // namespace

Files ReadEpisodes(const std::filesystem::path& dataset) {
  Files files;
  ForEachEpisode(dataset,
                 [&](const std::string& name, std::vector<std::uint8_t> bytes) { files[name] = std::move(bytes); });
  return files;
}

std::vector<Ack> ReadAcks(const std::vector<std::filesystem::path>& logs) {
  std::vector<Ack> acks;
  for (const auto& log : logs) {
    std::ifstream file(log);
    for (std::string line; std::getline(file, line) && !file.eof();) {
      std::istringstream words(line);
      std::string campaign, verdict;
      std::uint32_t attempt = 0;
      Ack ack;
      if (!(words >> campaign >> ack.index >> attempt >> ack.token >> verdict >> ack.sha256)) continue;
      ack.committed_now = verdict == "done";
      if (verdict != "refused") acks.push_back(std::move(ack));
    }
  }
  return acks;
}

std::string Counts::Text() const {
  return fmt::format("lost={} duplicated={} partial={} mismatched={}", lost, duplicated, partial, mismatched);
}

Counts& Counts::operator+=(const Counts& other) {
  lost += other.lost;
  duplicated += other.duplicated;
  partial += other.partial;
  mismatched += other.mismatched;
  acknowledged += other.acknowledged;
  files += other.files;
  return *this;
}

const Scanner::Look& Scanner::LookAt(std::uint64_t index, const std::vector<std::uint8_t>& bytes) {
  const auto [found, is_new] = seen_.try_emplace(fmt::format("{} {}", index, HexSha256(bytes)));
  Look& look = found->second;
  if (is_new) {
    const std::string_view text = AsText(bytes);
    look.whole = IsWhole(bytes);
    look.named_alike = Names(text, index);
    look.hashes = HashesIn(text);
  }
  return look;
}

// What is wrong with the file alone, and with one more of its index.
void Scanner::Add(const std::string& name, const std::vector<std::uint8_t>& bytes, There& there, Counts& counts) {
  const auto index = IndexOf(name);
  if (!index) return;
  ++counts.files;
  const Look& look = LookAt(*index, bytes);
  if (!there.emplace(*index, &look).second) ++counts.duplicated;
  if (!look.whole)
    ++counts.partial;
  else if (!look.named_alike)
    ++counts.mismatched;
}

// Of what was promised.
void Scanner::Hold(const std::vector<Ack>& acks, const There& there, Counts& counts) {
  std::map<std::uint64_t, std::set<std::uint64_t>> tokens;
  std::set<std::uint64_t> acknowledged, missing, different;
  for (const Ack& ack : acks) {
    acknowledged.insert(ack.index);
    if (ack.committed_now) tokens[ack.index].insert(ack.token);
    const auto found = there.find(ack.index);
    if (found == there.end())
      missing.insert(ack.index);
    else if (ack.committed_now && !ack.sha256.empty() && !found->second->hashes.contains(ack.sha256))
      different.insert(ack.index);
  }
  counts.acknowledged = acknowledged.size();
  counts.lost = missing.size();
  counts.mismatched += different.size();
  for (const auto& [index, of_index] : tokens) counts.duplicated += of_index.size() - 1;
}

Counts Scanner::Scan(const Files& files, const std::vector<Ack>& acks) {
  Counts counts;
  There there;
  for (const auto& [name, bytes] : files) Add(name, bytes, there, counts);
  Hold(acks, there, counts);
  return counts;
}

Counts Scanner::ScanFolder(const std::filesystem::path& dataset, const std::vector<Ack>& acks) {
  Counts counts;
  There there;
  ForEachEpisode(dataset, [&](const std::string& name, const std::vector<std::uint8_t>& bytes) {
    Add(name, bytes, there, counts);
  });
  Hold(acks, there, counts);
  return counts;
}

}  // namespace etude::faults
