// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: an off-screen OpenGL context without any window system.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "services/core/result.h"

namespace etude::sim {

/// Which context is wanted.
struct GlOptions {
  std::string backend = "auto";       ///< auto (EGL, then OSMesa) | egl | osmesa
  std::string renderer = "software";  ///< software | gpu, which is EGL's matter alone
  int device = -1;                    ///< with renderer gpu: its number in EGL's list; -1: the first that is a GPU
};

/// Whether a driver that calls itself so (GL_RENDERER) draws on the CPU.
bool IsSoftwareRenderer(std::string_view gl_renderer);

/// Current in the thread that made it. Destroy it there, too.
class GlContext {
 public:
  virtual ~GlContext() = default;
  GlContext(const GlContext&) = delete;
  GlContext& operator=(const GlContext&) = delete;

  /// What it returns draws as `options.renderer` says, or there is an error: a GPU's driver never stands in for the
  /// software, nor the other way round.
  /// @error kInvalidArgument: another word; kUnavailable: what was tried, which devices there are, why not, what to
  /// install
  static Result<std::unique_ptr<GlContext>> Open(const GlOptions& options);

  /// Cheap when it is current already.
  virtual void MakeCurrent() = 0;
  virtual const std::string& backend() const = 0;
  /// GL_RENDERER; the context must be current.
  std::string DriverName() const;

 protected:
  GlContext() = default;
  virtual void* Function(const char* name) const = 0;
};

}  // namespace etude::sim
