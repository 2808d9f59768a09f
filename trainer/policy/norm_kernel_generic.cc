// SPDX-License-Identifier: Apache-2.0
// The kernel for any CPU, and the choice between the three.
#define ETUDE_NORM_NAMESPACE generic
#include "trainer/policy/norm_kernel.inc"
#include "trainer/policy/torch_process.h"

namespace etude::policy {

const NormKernel& NormKernelFor(NormType type) {
#if defined(ETUDE_NORM_X86)
  static const bool has_avx512 = HasAvx512(), has_avx2 = HasAvx2();
  if (has_avx512) return avx512::Kernel(type);
  if (has_avx2) return avx2::Kernel(type);
#endif
  return generic::Kernel(type);
}

}  // namespace etude::policy
