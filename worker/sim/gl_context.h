// SPDX-License-Identifier: Apache-2.0
// Private to worker/sim: an off-screen OpenGL context without any window system.
#pragma once

#include <memory>
#include <string>

#include "services/core/result.h"

namespace etude::sim {

/// Current in the thread that made it. Destroy it there, too.
class GlContext {
 public:
  virtual ~GlContext() = default;
  GlContext(const GlContext&) = delete;
  GlContext& operator=(const GlContext&) = delete;

  /// @param backend  auto (EGL, then OSMesa) | egl | osmesa
  /// @error kInvalidArgument: another word; kUnavailable: what was tried, why not, what to install
  static Result<std::unique_ptr<GlContext>> Open(const std::string& backend);

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
