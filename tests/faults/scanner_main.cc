// SPDX-License-Identifier: Apache-2.0
// fault_scanner DATASET ACK_LOG...: prints what is lost, duplicated, partial, mismatched; exit 1 when anything is.
#include <cstdio>

#include "tests/faults/scanner.h"

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: fault_scanner DATASET ACK_LOG...\n");
    return 2;
  }
  etude::faults::Scanner scanner;
  const auto counts = scanner.ScanFolder(argv[1], etude::faults::ReadAcks({argv + 2, argv + argc}));
  std::printf("%s (%llu acknowledged, %llu files)\n", counts.Text().c_str(),
              static_cast<unsigned long long>(counts.acknowledged), static_cast<unsigned long long>(counts.files));
  return counts.clean() ? 0 : 1;
}
