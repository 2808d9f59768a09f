// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/torch_process.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <torch/version.h>

#include <cstdlib>
#include <map>
#include <string>

#include "services/core/cores.h"
#include "services/core/pinned_process.h"
#include "trainer/policy/torch.h"

namespace etude::policy {
namespace {

// Every step allocates the same tensors of megabytes: memory that goes back to the kernel in between costs more than
// the step in page faults. Replicas that share an arena wait for each other, so each keeps its own; an arena's heaps
// are of 64 MiB, and with a pad of as much none is ever given back. Large pages where the kernel has them for the
// asking.
constexpr const char* kKeepMemory =
    "glibc.malloc.mmap_max=0:glibc.malloc.trim_threshold=8589934592:"
    "glibc.malloc.top_pad=67108864:glibc.malloc.hugetlb=1";

}  // namespace

void PrepareTorchProcess(char** argv) {
  std::map<std::string, std::string> environment{{"OMP_WAIT_POLICY", "PASSIVE"}};
  // OpenBLAS picks AVX2 kernels on CPUs that are younger than it is; half the speed of AVX-512.
  if (HasAvx512()) environment["OPENBLAS_CORETYPE"] = "SkylakeX";
  std::erase_if(environment, [](const auto& variable) { return std::getenv(variable.first.c_str()) != nullptr; });
  // what a user tunes holds, and ours beside it
  const char* tunables = std::getenv("GLIBC_TUNABLES");
  environment["GLIBC_TUNABLES"] = JoinTunables(tunables != nullptr ? tunables : "", kKeepMemory);
  StartAgainWith(environment, argv);  // where it cannot be started anew: slower, not wrong
}

void SetTorchThreads(int threads) {
  if (threads <= 0) threads = Cores();
  at::set_num_threads(threads);
  at::globalContext().setFlushDenormal(true);
}

bool HasAvx512() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq");
#else
  return false;
#endif
}

bool HasAvx2() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
  return false;
#endif
}

bool HasFastBf16() { return HasAvx512(); }

std::string DescribeTorch() {
  using CoreName = char* (*)();
  const auto core = reinterpret_cast<CoreName>(::dlsym(RTLD_DEFAULT, "openblas_get_corename"));
  return fmt::format("libtorch {}, {} threads, {}, convolutions in {}", TORCH_VERSION, at::get_num_threads(),
                     core != nullptr ? fmt::format("OpenBLAS {}", core()) : "BLAS unknown",
                     HasFastBf16() ? "bf16" : "float32 (bf16 needs AVX-512)");
}

}  // namespace etude::policy
