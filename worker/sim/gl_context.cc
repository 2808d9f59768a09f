// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/gl_context.h"

#define EGL_EGLEXT_PROTOTYPES 0
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/osmesa.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "services/core/check.h"
#include "services/core/log.h"

namespace etude::sim {
namespace {

/// A shared library opened at run time. MuJoCo looks for GL functions in whichever of libGL, libEGL
/// and libOSMesa the process has loaded, so a library whose context failed is unloaded again; one
/// that works stays for good (Pin), since MuJoCo keeps what it found.
class Library {
 public:
  explicit Library(const char* name) : name_(name), handle_(dlopen(name, RTLD_NOW | RTLD_GLOBAL)) {
    if (!handle_) error_ = dlerror();
  }
  ~Library() {
    if (handle_) dlclose(handle_);
  }
  Library(Library&& other) noexcept
      : name_(other.name_), handle_(std::exchange(other.handle_, nullptr)), complete_(other.complete_) {}
  explicit operator bool() const { return handle_ != nullptr; }
  const std::string& error() const { return error_; }

  /// A function of it, for a pointer of its type; null where the library or the function is missing.
  struct Symbol {
    void* address;
    template <class Function>
    operator Function*() const {
      return reinterpret_cast<Function*>(address);
    }
  };
  Symbol Find(const char* name) {
    void* address = handle_ ? dlsym(handle_, name) : nullptr;
    complete_ = complete_ && address;
    return {address};
  }
  bool complete() const { return complete_; }  ///< all that was looked for was there
  void Pin() const { dlopen(name_, RTLD_NOW | RTLD_NODELETE); }

 private:
  const char* name_;
  void* handle_;
  std::string error_;
  bool complete_ = true;
};

bool IsLoaded(const char* name) {
  void* handle = dlopen(name, RTLD_LAZY | RTLD_NOLOAD);
  if (handle) dlclose(handle);
  return handle != nullptr;
}

struct Egl {
  Library library{"libEGL.so.1"};
  decltype(&eglGetPlatformDisplay) GetPlatformDisplay = library.Find("eglGetPlatformDisplay");
  decltype(&eglInitialize) Initialize = library.Find("eglInitialize");
  decltype(&eglBindAPI) BindApi = library.Find("eglBindAPI");
  decltype(&eglChooseConfig) ChooseConfig = library.Find("eglChooseConfig");
  decltype(&eglCreateContext) CreateContext = library.Find("eglCreateContext");
  decltype(&eglDestroyContext) DestroyContext = library.Find("eglDestroyContext");
  decltype(&eglMakeCurrent) MakeCurrent = library.Find("eglMakeCurrent");
  decltype(&eglGetCurrentContext) GetCurrentContext = library.Find("eglGetCurrentContext");
  decltype(&eglGetProcAddress) GetProcAddress = library.Find("eglGetProcAddress");
  decltype(&eglGetError) GetError = library.Find("eglGetError");
};

class EglContext : public GlContext {
 public:
  EglContext(Egl egl, EGLDisplay display, EGLContext context)
      : egl_(std::move(egl)), display_(display), context_(context) {}
  // the display is shared by all contexts of the process and lives as long as it
  ~EglContext() override {
    if (egl_.GetCurrentContext() == context_)
      egl_.MakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    egl_.DestroyContext(display_, context_);
  }

  void MakeCurrent() override {
    if (egl_.GetCurrentContext() == context_) return;
    ETUDE_CHECK(egl_.MakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_), "EGL error {:#x}",
                egl_.GetError());
  }
  const std::string& backend() const override {
    static const std::string name = "egl";
    return name;
  }

  static Result<std::unique_ptr<GlContext>> Open();

 protected:
  void* Function(const char* name) const override { return reinterpret_cast<void*>(egl_.GetProcAddress(name)); }

 private:
  Egl egl_;
  EGLDisplay display_;
  EGLContext context_;
};

/// Displays without a window system: Mesa's surfaceless one (software or any render node), then the
/// GPUs that the driver lists itself.
std::vector<EGLDisplay> Displays(const Egl& egl) {
  std::vector<EGLDisplay> displays;
  displays.push_back(egl.GetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr));
  const auto query = reinterpret_cast<PFNEGLQUERYDEVICESEXTPROC>(egl.GetProcAddress("eglQueryDevicesEXT"));
  std::array<EGLDeviceEXT, 16> devices{};
  EGLint count = 0;
  if (query && query(static_cast<EGLint>(devices.size()), devices.data(), &count))
    for (EGLint i = 0; i < count; ++i)
      displays.push_back(egl.GetPlatformDisplay(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr));
  std::erase(displays, EGL_NO_DISPLAY);
  return displays;
}

/// A desktop-GL context on `display`, or EGL_NO_CONTEXT.
EGLContext ContextOn(const Egl& egl, EGLDisplay display) {
  EGLint major = 0, minor = 0, count = 0;
  if (!egl.Initialize(display, &major, &minor)) return EGL_NO_CONTEXT;
  const EGLint wanted[] = {EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_NONE};
  EGLConfig config = nullptr;
  if (!egl.ChooseConfig(display, wanted, &config, 1, &count) || count < 1) return EGL_NO_CONTEXT;
  if (!egl.BindApi(EGL_OPENGL_API)) return EGL_NO_CONTEXT;
  const EGLint attributes[] = {EGL_NONE};  // compatibility profile: MuJoCo draws with the old pipeline
  const EGLContext context = egl.CreateContext(display, config, EGL_NO_CONTEXT, attributes);
  if (context == EGL_NO_CONTEXT) return context;
  if (egl.MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) return context;
  egl.DestroyContext(display, context);
  return EGL_NO_CONTEXT;
}

Result<std::unique_ptr<GlContext>> EglContext::Open() {
  Egl egl;
  if (!egl.library) return Fail(Code::kUnavailable, egl.library.error());
  if (!egl.library.complete()) return Fail(Code::kUnavailable, "libEGL.so.1 is older than EGL 1.5");
  const std::vector<EGLDisplay> displays = Displays(egl);
  for (const EGLDisplay display : displays) {
    const EGLContext context = ContextOn(egl, display);
    if (context == EGL_NO_CONTEXT) continue;
    egl.library.Pin();
    return std::make_unique<EglContext>(std::move(egl), display, context);
  }
  return Fail(Code::kUnavailable, fmt::format("none of {} surfaceless or device displays gave a desktop OpenGL context "
                                              "(last EGL error {:#x})",
                                              displays.size(), egl.GetError()));
}

struct OsMesa {
  Library library{"libOSMesa.so.8"};
  decltype(&OSMesaCreateContextAttribs) Create = library.Find("OSMesaCreateContextAttribs");
  decltype(&OSMesaDestroyContext) Destroy = library.Find("OSMesaDestroyContext");
  decltype(&OSMesaMakeCurrent) MakeCurrent = library.Find("OSMesaMakeCurrent");
  decltype(&OSMesaGetCurrentContext) GetCurrent = library.Find("OSMesaGetCurrentContext");
  decltype(&OSMesaGetProcAddress) GetProcAddress = library.Find("OSMesaGetProcAddress");
};

class OsMesaGlContext : public GlContext {
 public:
  OsMesaGlContext(OsMesa mesa, OSMesaContext context) : mesa_(std::move(mesa)), context_(context) {}
  ~OsMesaGlContext() override { mesa_.Destroy(context_); }

  void MakeCurrent() override {
    if (mesa_.GetCurrent() == context_) return;
    ETUDE_CHECK(Bind(), "OSMesaMakeCurrent failed");
  }
  const std::string& backend() const override {
    static const std::string name = "osmesa";
    return name;
  }

  static Result<std::unique_ptr<GlContext>> Open() {
    for (const char* other : {"libGLX.so.0", "libGL.so.1", "libEGL.so.1"})
      if (IsLoaded(other))
        return Fail(Code::kUnavailable,
                    fmt::format("{} is loaded in this process, and MuJoCo would take its functions; "
                                "choose backend osmesa from the start",
                                other));
    OsMesa mesa;
    if (!mesa.library) return Fail(Code::kUnavailable, mesa.library.error());
    if (!mesa.library.complete()) return Fail(Code::kUnavailable, "libOSMesa.so.8 is too old");
    const int attributes[] = {OSMESA_FORMAT,
                              OSMESA_RGBA,
                              OSMESA_DEPTH_BITS,
                              24,
                              OSMESA_STENCIL_BITS,
                              8,
                              OSMESA_PROFILE,
                              OSMESA_COMPAT_PROFILE,
                              0};
    const OSMesaContext context = mesa.Create(attributes, nullptr);
    if (!context) return Fail(Code::kUnavailable, "OSMesa made no context");
    mesa.library.Pin();
    auto opened = std::make_unique<OsMesaGlContext>(std::move(mesa), context);
    if (!opened->Bind()) return Fail(Code::kUnavailable, "OSMesa's context could not be made current");
    return opened;
  }

 protected:
  void* Function(const char* name) const override { return reinterpret_cast<void*>(mesa_.GetProcAddress(name)); }

 private:
  /// OSMesa wants a default framebuffer; we draw into our own, so a tiny one does.
  bool Bind() { return mesa_.MakeCurrent(context_, pixels_.data(), GL_UNSIGNED_BYTE, kSide, kSide) == GL_TRUE; }

  static constexpr int kSide = 16;
  OsMesa mesa_;
  OSMesaContext context_;
  std::array<std::uint8_t, kSide * kSide * 4> pixels_{};
};

}  // namespace

std::string GlContext::DriverName() const {
  using GetString = const GLubyte*(GLAPIENTRY*)(GLenum);
  const auto get = reinterpret_cast<GetString>(Function("glGetString"));
  const GLubyte* name = get ? get(GL_RENDERER) : nullptr;
  return name ? reinterpret_cast<const char*>(name) : "unknown";
}

Result<std::unique_ptr<GlContext>> GlContext::Open(const std::string& backend) {
  if (backend != "auto" && backend != "egl" && backend != "osmesa")
    return Fail(Code::kInvalidArgument,
                fmt::format("renderer backend '{}' is not known; known: auto, egl, osmesa", backend));
  // Mesa's rasteriser threads only get in the way of one worker per core (measured); must be set
  // before the first context. A user's own setting wins.
  setenv("LP_NUM_THREADS", "0", 0);
  std::string tried;
  if (backend != "osmesa") {
    auto context = EglContext::Open();
    if (context) return context;
    tried += "\n  EGL: " + context.error().message;
  }
  if (backend != "egl") {
    auto context = OsMesaGlContext::Open();
    if (context) return context;
    tried += "\n  OSMesa: " + context.error().message;
  }
  return Fail(Code::kUnavailable, "no off-screen OpenGL for rendering. Tried:" + tried +
                                      "\nInstall Mesa's drivers: apt install libegl1 libgl1-mesa-dri libosmesa6");
}

}  // namespace etude::sim
