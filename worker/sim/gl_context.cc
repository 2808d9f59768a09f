// SPDX-License-Identifier: Apache-2.0
#include "worker/sim/gl_context.h"

#define EGL_EGLEXT_PROTOTYPES 0
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/osmesa.h>
#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
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

// The display is shared by all contexts of the process and lives as long as it.
void Release(const Egl& egl, EGLDisplay display, EGLContext context) {
  if (egl.GetCurrentContext() == context) egl.MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  egl.DestroyContext(display, context);
}

// Of the context that is current. @param get_string  its glGetString
std::string DriverNameOf(void* get_string) {
  using GetString = const GLubyte*(GLAPIENTRY*)(GLenum);
  const auto get = reinterpret_cast<GetString>(get_string);
  const GLubyte* name = get ? get(GL_RENDERER) : nullptr;
  return name ? reinterpret_cast<const char*>(name) : "unknown";
}

class EglContext : public GlContext {
 public:
  EglContext(Egl egl, EGLDisplay display, EGLContext context)
      : egl_(std::move(egl)), display_(display), context_(context) {}
  ~EglContext() override { Release(egl_, display_, context_); }

  void MakeCurrent() override {
    if (egl_.GetCurrentContext() == context_) return;
    ETUDE_CHECK(egl_.MakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_), "EGL error {:#x}",
                egl_.GetError());
  }
  const std::string& backend() const override {
    static const std::string name = "egl";
    return name;
  }

  static Result<std::unique_ptr<GlContext>> Open(const GlOptions& options);

 protected:
  void* Function(const char* name) const override { return reinterpret_cast<void*>(egl_.GetProcAddress(name)); }

 private:
  Egl egl_;
  EGLDisplay display_;
  EGLContext context_;
};

/// A GPU, or Mesa's software renderer, as EGL lists it.
struct Device {
  EGLDeviceEXT handle;
  bool is_software;
  std::string name;  ///< "/dev/dri/card0 (NVIDIA H100 PCIe)"
};

// EGL's order: what `device` of a campaign counts in. Empty where EGL has no such list.
std::vector<Device> Devices(const Egl& egl) {
  const auto query = reinterpret_cast<PFNEGLQUERYDEVICESEXTPROC>(egl.GetProcAddress("eglQueryDevicesEXT"));
  const auto text = reinterpret_cast<PFNEGLQUERYDEVICESTRINGEXTPROC>(egl.GetProcAddress("eglQueryDeviceStringEXT"));
  std::array<EGLDeviceEXT, 64> handles{};
  EGLint count = 0;
  if (!query || !text || !query(static_cast<EGLint>(handles.size()), handles.data(), &count)) return {};
  std::vector<Device> devices;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const auto said = [&](EGLint what) -> std::string {
      const char* const word = text(handles[i], what);
      return word ? word : "";
    };
    const std::string extensions = said(EGL_EXTENSIONS);
    const auto has = [&](const char* extension) { return extensions.find(extension) != std::string::npos; };
    Device device{handles[i], has("EGL_MESA_device_software"), ""};
    device.name = device.is_software ? "Mesa's software renderer" : said(EGL_DRM_DEVICE_FILE_EXT);
    if (device.name.empty()) device.name = "a GPU without a device file";
    if (has("EGL_EXT_device_query_name")) device.name += fmt::format(" ({})", said(EGL_RENDERER_EXT));
    devices.push_back(std::move(device));
  }
  return devices;
}

/// Where a context may be had, and what that is called in an error.
struct Place {
  std::string name;
  EGLDisplay display = EGL_NO_DISPLAY;
};

EGLDisplay DisplayOf(const Egl& egl, const Device& device) {
  return egl.GetPlatformDisplay(EGL_PLATFORM_DEVICE_EXT, device.handle, nullptr);
}

// Mesa's surfaceless display, then its software renderer where EGL lists that.
std::vector<Place> SoftwarePlaces(const Egl& egl) {
  std::vector<Place> places{
      {"surfaceless", egl.GetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr)}};
  for (const Device& device : Devices(egl))
    if (device.is_software) places.push_back({device.name, DisplayOf(egl, device)});
  return places;
}

// "\n    device 0: /dev/dri/card0"
std::string ListText(const std::vector<Device>& devices) {
  std::string text;
  for (std::size_t i = 0; i < devices.size(); ++i) text += fmt::format("\n    device {}: {}", i, devices[i].name);
  return text.empty() ? "\n    none" : text;
}

Result<std::vector<Place>> GpuPlaces(const Egl& egl, int number) {
  const std::vector<Device> devices = Devices(egl);
  const auto refuse = [&](const std::string& why) {
    return Fail(Code::kUnavailable, fmt::format("{}. EGL lists:{}", why, ListText(devices)));
  };
  if (number >= static_cast<int>(devices.size())) return refuse(fmt::format("there is no device {}", number));
  if (number >= 0 && devices[static_cast<std::size_t>(number)].is_software)
    return refuse(fmt::format("device {} is no GPU", number));
  std::vector<Place> places;
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (!devices[i].is_software && (number < 0 || i == static_cast<std::size_t>(number)))
      places.push_back({fmt::format("device {}: {}", i, devices[i].name), DisplayOf(egl, devices[i])});
  if (places.empty()) return refuse("there is no GPU");
  return places;
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

// Mesa draws on the CPU with this variable, also where it has a driver for the GPU. It looks when a display is
// initialized; software and GPUs have displays of their own. What is set already is left alone: other threads may read
// the environment.
void TellMesa(bool software) {
  constexpr char kVariable[] = "LIBGL_ALWAYS_SOFTWARE";
  const std::string_view wanted = software ? "1" : "0";
  const char* const now = std::getenv(kVariable);
  if (!now || wanted != now) ::setenv(kVariable, wanted.data(), 1);
}

Result<std::unique_ptr<GlContext>> EglContext::Open(const GlOptions& options) {
  Egl egl;
  if (!egl.library) return Fail(Code::kUnavailable, egl.library.error());
  if (!egl.library.complete()) return Fail(Code::kUnavailable, "libEGL.so.1 is older than EGL 1.5");
  const bool software = options.renderer == "software";
  TellMesa(software);
  std::vector<Place> places;
  if (software) {
    places = SoftwarePlaces(egl);
  } else {
    ETUDE_ASSIGN_OR_RETURN(places, GpuPlaces(egl, options.device));
  }
  std::string refused;
  for (const Place& place : places) {
    const EGLContext context = place.display == EGL_NO_DISPLAY ? EGL_NO_CONTEXT : ContextOn(egl, place.display);
    if (context == EGL_NO_CONTEXT) {
      refused += fmt::format("\n    {}: no desktop OpenGL context (last EGL error {:#x})", place.name, egl.GetError());
      continue;
    }
    const std::string driver = DriverNameOf(reinterpret_cast<void*>(egl.GetProcAddress("glGetString")));
    if (IsSoftwareRenderer(driver) == software) {
      egl.library.Pin();
      return std::make_unique<EglContext>(std::move(egl), place.display, context);
    }
    Release(egl, place.display, context);
    refused += fmt::format("\n    {}: its driver is '{}', {}", place.name, driver,
                           software ? "a GPU's" : "which draws on the CPU");
  }
  return Fail(Code::kUnavailable, "no display gave what is wanted:" + refused);
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

bool IsSoftwareRenderer(std::string_view gl_renderer) {
  std::string name(gl_renderer);
  std::ranges::transform(name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::ranges::any_of(std::array{"llvmpipe", "softpipe", "swrast", "software", "swr (", "swiftshader"},
                             [&](const char* word) { return name.find(word) != std::string::npos; });
}

std::string GlContext::DriverName() const { return DriverNameOf(Function("glGetString")); }

namespace {

Result<std::unique_ptr<GlContext>> OpenGpu(const GlOptions& options) {
  if (options.backend == "osmesa")
    return Fail(Code::kInvalidArgument,
                "renderer gpu: backend osmesa draws on the CPU; take egl, or renderer software");
  auto context = EglContext::Open(options);
  if (context) return context;
  const std::string wanted = options.device < 0 ? "" : fmt::format(", device {}", options.device);
  return Fail(Code::kUnavailable,
              fmt::format("renderer gpu{}: no GPU draws here: {}\nInstall the GPU's driver with its EGL, let this user "
                          "open its device file (group render), or collect with renderer: software",
                          wanted, context.error().message));
}

}  // namespace

Result<std::unique_ptr<GlContext>> GlContext::Open(const GlOptions& options) {
  const std::string& backend = options.backend;
  if (backend != "auto" && backend != "egl" && backend != "osmesa")
    return Fail(Code::kInvalidArgument,
                fmt::format("renderer backend '{}' is not known; known: auto, egl, osmesa", backend));
  if (options.renderer != "software" && options.renderer != "gpu")
    return Fail(Code::kInvalidArgument,
                fmt::format("renderer '{}' is not known; known: software, gpu", options.renderer));
  if (options.renderer == "gpu") return OpenGpu(options);
  // Mesa's rasteriser threads only get in the way of one worker per core (measured); must be set
  // before the first context. A user's own setting wins.
  setenv("LP_NUM_THREADS", "0", 0);
  std::string tried;
  if (backend != "osmesa") {
    auto context = EglContext::Open(options);
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
