// SPDX-License-Identifier: Apache-2.0
// Every target of this program with its seeds and its corpus, and with thousands of seeded mutations of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "services/core/clock.h"
#include "services/core/file.h"
#include "services/core/rng.h"
#include "tests/fuzz/targets.h"

namespace etude::fuzz {
namespace mutation_test {

// Seconds a target: what ETUDE_FUZZ_SECONDS says, else as long as kMutations take.
constexpr int kMutations = 2000;

std::uint64_t Position(Rng& rng, const Bytes& bytes) { return rng.Below(bytes.size() + 1); }

// One change: a bit, a number that is often a boundary, a piece away, twice, or from another place.
void Change(Bytes& bytes, Rng& rng) {
  constexpr std::uint32_t kBoundaries[] = {0, 1, 0x7f, 0x80, 0xff, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff};
  if (bytes.empty()) return bytes.push_back(static_cast<std::uint8_t>(rng.Below(256)));
  const auto from = static_cast<std::ptrdiff_t>(rng.Below(bytes.size()));
  const auto length = static_cast<std::ptrdiff_t>(
      std::min<std::uint64_t>(1 + rng.Below(32), bytes.size() - static_cast<std::uint64_t>(from)));
  const Bytes piece(bytes.begin() + from, bytes.begin() + from + length);
  switch (rng.Below(6)) {
    case 0:
      bytes[static_cast<std::size_t>(from)] ^= static_cast<std::uint8_t>(1u << rng.Below(8));
      return;
    case 1: {
      const std::uint32_t value = kBoundaries[rng.Below(std::size(kBoundaries))];
      for (std::ptrdiff_t i = 0; i < std::min<std::ptrdiff_t>(4, length); ++i)
        bytes[static_cast<std::size_t>(from + i)] = static_cast<std::uint8_t>(value >> (8 * i));
      return;
    }
    case 2:
      bytes.erase(bytes.begin() + from, bytes.begin() + from + length);
      return;
    case 3:
      bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(Position(rng, bytes)), piece.begin(), piece.end());
      return;
    case 4:
      bytes.resize(static_cast<std::size_t>(from));
      return;
    default:
      bytes[static_cast<std::size_t>(from)] = static_cast<std::uint8_t>(rng.Below(256));
  }
}

// The target's seeds, then what is kept in tests/fuzz/corpus: inputs that once were news, and those of findings.
std::vector<Bytes> SeedsOf(const Target& target) {
  std::vector<Path> files;
  std::error_code error;
  for (std::filesystem::directory_iterator it(Path("tests/fuzz/corpus") / target.name, error), end; !error && it != end;
       it.increment(error))
    files.push_back(it->path());
  std::sort(files.begin(), files.end());
  std::vector<Bytes> seeds = target.seeds;
  for (const Path& file : files) {
    const auto bytes = ReadBinaryFile(file);
    EXPECT_TRUE(bytes) << bytes.error().message;
    if (bytes) seeds.push_back(*bytes);
  }
  EXPECT_FALSE(files.empty()) << "no corpus of " << target.name << ": run the test in the root of the sources";
  return seeds;
}

class Mutations : public testing::TestWithParam<std::size_t> {};

TEST_P(Mutations, NeitherCrashNorRunAway) {
  const Target& target = Targets()[GetParam()];
  const std::vector<Bytes> seeds = SeedsOf(target);
  for (const Bytes& seed : seeds) target.run(seed);
  const char* text = std::getenv("ETUDE_FUZZ_SECONDS");
  const double seconds = text == nullptr ? 0 : std::atof(text);
  Rng rng(7 + GetParam());
  const Stopwatch watch;
  std::uint64_t tried = 0;
  for (; seconds > 0 ? watch.Seconds() < seconds : tried < kMutations; ++tried) {
    Bytes bytes = seeds[rng.Below(seeds.size())];
    for (std::uint64_t changes = 1 + rng.Below(4); changes > 0; --changes) Change(bytes, rng);
    const Bytes exact = bytes;  // no room behind its end that a reader could run into unseen
    target.run(exact);
  }
  std::printf("%s: %llu inputs in %.1f s\n", target.name.c_str(), static_cast<unsigned long long>(tried),
              watch.Seconds());
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Mutations, testing::Range<std::size_t>(0, Targets().size()),
                         [](const auto& info) { return Targets()[info.param].name; });

}  // namespace mutation_test
}  // namespace etude::fuzz
