// SPDX-License-Identifier: Apache-2.0
// Holds what senders were told (their acknowledgement logs, services/campaign/ack_log.h) against what lies in a
// dataset. Reads bytes and names, nothing through services/store: a fault in the store's own checks must not hide
// itself. What it knows of an episode file: it is HDF5, it ends with a seal (CRC-32 and size of all before), it names
// its group demo_INDEX and holds, as text, the SHA-256 of the bytes that the sender sent.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

namespace etude::faults {

/// The files of a dataset: path below it -> bytes. What a folder holds, or what a model of a disk holds.
using Files = std::map<std::string, std::vector<std::uint8_t>>;

/// Everything below FOLDER/episodes.
Files ReadEpisodes(const std::filesystem::path& dataset);

/// One acknowledgement.
struct Ack {
  std::uint64_t index = 0;
  std::uint64_t token = 0;
  bool committed_now = false;  ///< "done", not "duplicate"
  std::string sha256;          ///< of the bytes that were sent; empty: not known
};

/// Lines of files that are there; a torn last line counts as none. Refusals are left out.
std::vector<Ack> ReadAcks(const std::vector<std::filesystem::path>& logs);

struct Counts {
  std::uint64_t lost = 0;        ///< acknowledged, and no file of it
  std::uint64_t duplicated = 0;  ///< two files of one index, or two tokens that were told they had committed it
  std::uint64_t partial = 0;     ///< visible files that are not whole
  std::uint64_t mismatched = 0;  ///< whole files of another index, or of other bytes than those acknowledged
  std::uint64_t acknowledged = 0, files = 0;

  bool clean() const { return lost == 0 && duplicated == 0 && partial == 0 && mismatched == 0; }
  /// "lost=0 duplicated=0 partial=0 mismatched=0"
  std::string Text() const;
  Counts& operator+=(const Counts& other);
};

/// Looks at every file once; keep one scanner where many states of the same files are scanned.
class Scanner {
 public:
  Counts Scan(const Files& files, const std::vector<Ack>& acks);
  /// The same of everything below FOLDER/episodes, of which one file at a time is in memory.
  Counts ScanFolder(const std::filesystem::path& dataset, const std::vector<Ack>& acks);

 private:
  struct Look {
    bool whole = false;
    bool named_alike = false;
    std::set<std::string> hashes;  ///< texts of 64 hexadecimal digits in it
  };
  using There = std::map<std::uint64_t, const Look*>;  // by index
  void Add(const std::string& name, const std::vector<std::uint8_t>& bytes, There& there, Counts& counts);
  static void Hold(const std::vector<Ack>& acks, const There& there, Counts& counts);
  const Look& LookAt(std::uint64_t index, const std::vector<std::uint8_t>& bytes);

  std::map<std::string, Look> seen_;  // by index and SHA-256
};

}  // namespace etude::faults
