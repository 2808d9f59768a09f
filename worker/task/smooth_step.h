// SPDX-License-Identifier: Apache-2.0
// A smooth way from 0 to 1, for what is slid or pushed from rest to rest.
#pragma once

namespace etude::task {

/// From 0 at s = 0 to 1 at s = 1, at rest at both ends.
inline double SmoothStep(double s) { return s * s * (3 - 2 * s); }
/// Its derivative.
inline double SmoothStepRate(double s) { return 6 * s * (1 - s); }

}  // namespace etude::task
