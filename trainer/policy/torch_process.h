// SPDX-License-Identifier: Apache-2.0
// How a process that computes with torch is set up: memory, threads, waiting, BLAS kernels. Includes no torch.
#pragma once

#include <string>

namespace etude::policy {

/// Call first in main. Sets what the C library, OpenMP and OpenBLAS read only once, at load (freed memory is kept,
/// passive waiting, one BLAS thread pool, AVX-512 kernels where the CPU has them but OpenBLAS does not know the model),
/// unless the user has set it, and then starts this program again with the same arguments. Returns when all is set.
void PrepareTorchProcess(char** argv);

/// Number of threads inside an operation (0: as many as cores); denormals to zero. Call once, after
/// PrepareTorchProcess, before the first operation.
void SetTorchThreads(int threads);

/// Whether this CPU has what AVX-512 kernels need: F, BW, VL and DQ.
bool HasAvx512();
/// Whether it has AVX2 and FMA.
bool HasAvx2();

/// True where bfloat16 convolutions are fast: oneDNN has them for AVX-512. On any other CPU it falls back to its scalar
/// reference, measured 35 times slower than a bf16 step with AVX-512.
bool HasFastBf16();

/// "libtorch 1.13.1, 2 threads, OpenBLAS SkylakeX, convolutions in bf16" for logs, benchmarks and `etude doctor`.
std::string DescribeTorch();

}  // namespace etude::policy
