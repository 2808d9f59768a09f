// SPDX-License-Identifier: Apache-2.0
// A target of this program for libFuzzer: the one that ETUDE_FUZZ_TARGET names at compile time. Its seeds are written
// into the folder that $ETUDE_FUZZ_SEEDS names before libFuzzer reads its corpora.
#include <algorithm>
#include <cstdlib>

#include "services/core/check.h"
#include "services/core/file.h"
#include "tests/fuzz/targets.h"

namespace etude::fuzz {
namespace {

const Target& TargetOfThisProgram() {
  static const Target& target = []() -> const Target& {
    const auto found = std::ranges::find(Targets(), std::string(ETUDE_FUZZ_TARGET), &Target::name);
    ETUDE_CHECK(found != Targets().end(), "no target '{}' in this program", ETUDE_FUZZ_TARGET);
    return *found;
  }();
  return target;
}

void WriteSeeds(const Path& folder) {
  int number = 0;
  for (const Bytes& seed : TargetOfThisProgram().seeds) {
    const Status written = WriteFileAtomically(folder / ("seed-" + std::to_string(number++)), seed);
    ETUDE_CHECK(written.has_value(), "{}", written.error().message);
  }
}

}  // namespace
}  // namespace etude::fuzz

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  if (const char* folder = std::getenv("ETUDE_FUZZ_SEEDS")) etude::fuzz::WriteSeeds(folder);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  etude::fuzz::TargetOfThisProgram().run({data, size});
  return 0;
}
