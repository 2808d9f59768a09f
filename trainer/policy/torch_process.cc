// SPDX-License-Identifier: Apache-2.0
#include "trainer/policy/torch_process.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <sys/auxv.h>
#include <sys/prctl.h>
#include <torch/torch.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <thread>

namespace etude::policy {
namespace {

/// Sets `name` unless it is set; true when that changed the environment.
bool SetDefault(const char* name, const char* value) {
  if (std::getenv(name) != nullptr) return false;
  ::setenv(name, value, 0);
  return true;
}

}  // namespace

void PrepareTorchProcess(char** argv) {
  // a program started anew through /proc/self/exe is called `exe` by ps and pkill
  ::prctl(PR_SET_NAME, program_invocation_short_name);
  // with raised privileges the loader takes such variables away again: it would be started anew for ever
  if (::getauxval(AT_SECURE) != 0) return;
  bool changed = SetDefault("OMP_WAIT_POLICY", "PASSIVE");
  // OpenBLAS picks AVX2 kernels on CPUs that are younger than it is; half the speed of AVX-512.
  if (HasAvx512()) changed |= SetDefault("OPENBLAS_CORETYPE", "SkylakeX");
  // Every step allocates the same tensors of megabytes: memory that goes back to the kernel in between costs a tenth of
  // the step in page faults.
  changed |= SetDefault("GLIBC_TUNABLES",
                        "glibc.malloc.mmap_max=0:glibc.malloc.trim_threshold=8589934592:"
                        "glibc.malloc.top_pad=268435456:glibc.malloc.arena_max=1");
  if (!changed) return;
  ::execv("/proc/self/exe", argv);
  // without /proc the program goes on as it is: slower, not wrong
}

void SetTorchThreads(int threads) {
  if (threads <= 0) threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
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

bool HasFastBf16() { return HasAvx512(); }

std::string DescribeTorch() {
  using CoreName = char* (*)();
  const auto core = reinterpret_cast<CoreName>(::dlsym(RTLD_DEFAULT, "openblas_get_corename"));
  return fmt::format("libtorch {}, {} threads, {}, convolutions in {}", TORCH_VERSION, at::get_num_threads(),
                     core != nullptr ? fmt::format("OpenBLAS {}", core()) : "BLAS unknown",
                     HasFastBf16() ? "bf16" : "float32 (bf16 needs AVX-512)");
}

}  // namespace etude::policy
