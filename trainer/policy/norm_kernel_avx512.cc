// SPDX-License-Identifier: Apache-2.0
// The kernel compiled with AVX-512 (see CMakeLists.txt); called only where the CPU has it.
#define ETUDE_NORM_NAMESPACE avx512
#include "trainer/policy/norm_kernel.inc"
