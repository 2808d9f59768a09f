// SPDX-License-Identifier: Apache-2.0
// The kernel compiled with AVX2 and FMA (see CMakeLists.txt); called only where the CPU has them.
#define ETUDE_NORM_NAMESPACE avx2
#include "trainer/policy/norm_kernel.inc"
