#include "render/gl/egl_context.hpp"

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "base/platform.hpp"

namespace flockstep::render {
namespace {

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

// Extension strings are words separated by spaces.
bool has_word(const char* words, std::string_view word) {
  if (words == nullptr) return false;
  std::istringstream stream{std::string(words)};
  for (std::string each; stream >> each;) {
    if (each == word) return true;
  }
  return false;
}

std::string error_name(EGLint error) {
  std::ostringstream text;
  text << "EGL error 0x" << std::hex << error;
  return text.str();
}

template <class Function>
Function extension_function(const char* name) {
  return reinterpret_cast<Function>(eglGetProcAddress(name));
}

// Returns the CUDA devices that the process may use. Returns nullopt if it may use all, or if they are not named by number.
std::optional<std::vector<EGLAttrib>> visible_cuda_devices() {
  const char* value = std::getenv("CUDA_VISIBLE_DEVICES");
  if (value == nullptr) return std::nullopt;
  std::vector<EGLAttrib> visible;
  std::istringstream stream{std::string(value)};
  for (std::string each; std::getline(stream, each, ',');) {
    int number = -1;
    const auto [end, error] = std::from_chars(each.data(), each.data() + each.size(), number);
    if (error != std::errc() || end != each.data() + each.size()) return std::nullopt;
    if (number < 0) break;  // as in CUDA, the entries after a negative one are not visible
    visible.push_back(number);
  }
  return visible;
}

struct Candidate {
  std::string name;
  EGLDeviceEXT device;
  std::size_t rank;  // lower ranks are tried first
};

// Lists the devices in the order in which to try them. Every device except the software one counts as hardware.
std::vector<Candidate> devices(EglDevices allowed, const char* client_extensions, std::string& why_none) {
  // Other hardware comes after the CUDA devices, whose rank is their number or their position in CUDA_VISIBLE_DEVICES.
  constexpr std::size_t kHardware = 1U << 16U;
  constexpr std::size_t kSoftware = 1U << 17U;
  if (!has_word(client_extensions, "EGL_EXT_platform_device") ||
      (!has_word(client_extensions, "EGL_EXT_device_base") && !has_word(client_extensions, "EGL_EXT_device_enumeration"))) {
    why_none = "EGL cannot list devices";
    return {};
  }
  const auto query_devices = extension_function<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
  const auto query_string = extension_function<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
  const auto query_attribute = extension_function<PFNEGLQUERYDEVICEATTRIBEXTPROC>("eglQueryDeviceAttribEXT");
  std::array<EGLDeviceEXT, 64> found{};
  EGLint count = 0;
  if (query_devices == nullptr || query_string == nullptr ||
      query_devices(static_cast<EGLint>(found.size()), found.data(), &count) != EGL_TRUE || count == 0) {
    why_none = "EGL lists no device";
    return {};
  }
  const auto visible = visible_cuda_devices();
  std::vector<Candidate> candidates;
  for (EGLint i = 0; i < count; ++i) {
    const EGLDeviceEXT device = found[static_cast<std::size_t>(i)];
    const char* extensions = query_string(device, EGL_EXTENSIONS);
    Candidate candidate{"EGL device " + std::to_string(i), device, kHardware};
    EGLAttrib cuda = -1;
    // Querying an attribute that a device lacks is an error, so the extensions are checked first.
    if (has_word(extensions, "EGL_MESA_device_software")) {
      candidate.name += " (software)";
      candidate.rank = kSoftware;
    } else if (has_word(extensions, "EGL_NV_device_cuda") && query_attribute != nullptr &&
               query_attribute(device, EGL_CUDA_DEVICE_NV, &cuda) == EGL_TRUE) {
      candidate.name += " (CUDA device " + std::to_string(cuda) + ")";
      candidate.rank = static_cast<std::size_t>(cuda);
      if (visible) {
        const auto at = std::find(visible->begin(), visible->end(), cuda);
        if (at == visible->end()) continue;
        candidate.rank = static_cast<std::size_t>(at - visible->begin());
      }
    }
    if (allowed == EglDevices::software && candidate.rank != kSoftware) continue;
    candidates.push_back(candidate);
  }
  std::stable_sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) { return a.rank < b.rank; });
  if (candidates.empty()) why_none = "no EGL device is allowed";
  return candidates;
}

}  // namespace

EglDevices egl_devices() {
  const std::string value = variable("FLOCKSTEP_EGL");
  if (value.empty()) return EglDevices::any;
  if (value == "none") return EglDevices::none;
  if (value == "software") return EglDevices::software;
  throw GlUnavailable("FLOCKSTEP_EGL: expected none or software, got \"" + value + '"');
}

EglContext::EglContext(EglDevices allowed) {
  if (allowed == EglDevices::none) throw GlUnavailable("EGL is switched off by FLOCKSTEP_EGL=none");
  // libepoxy exits the process if a library that it needs is missing, so this is checked first.
  if (const std::string why = gl_load_error(); !why.empty()) throw GlUnavailable(why);
  static const long first_process = process_id();  // the process that owns the displays and the drivers' threads
  if (process_id() != first_process) {
    throw GlUnavailable("OpenGL was set up before this process was forked, and works only in its parent");
  }
  const char* client_extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  const auto get_platform_display = extension_function<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
  if (client_extensions == nullptr || get_platform_display == nullptr) {
    throw GlUnavailable("this EGL has no headless platforms (EGL_EXT_platform_base)");
  }
  std::string tried;
  const auto attempt = [&](const std::string& name, EGLenum platform, void* native) {
    const EGLDisplay display = get_platform_display(platform, native, nullptr);
    const std::string why_not = display == EGL_NO_DISPLAY ? "no display" : try_display(display, allowed);
    if (why_not.empty()) return true;
    tried += (tried.empty() ? "" : "; ") + name + ": " + why_not;
    return false;
  };
  std::string why_none;
  for (const Candidate& candidate : devices(allowed, client_extensions, why_none)) {
    if (attempt(candidate.name, EGL_PLATFORM_DEVICE_EXT, candidate.device)) return;
  }
  tried += why_none;
  if (has_word(client_extensions, "EGL_MESA_platform_surfaceless") &&
      attempt("surfaceless platform", EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY)) {
    return;
  }
  throw GlUnavailable("no headless OpenGL 4.5: " + tried);
}

std::string EglContext::try_display(void* display, EglDevices allowed) {
  EGLint major = 0;
  EGLint minor = 0;
  if (eglInitialize(display, &major, &minor) != EGL_TRUE) return "initialisation failed, " + error_name(eglGetError());
  const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
  if (!has_word(extensions, "EGL_KHR_surfaceless_context") || !has_word(extensions, "EGL_KHR_create_context"))
    return "no contexts without a surface";
  if (eglBindAPI(EGL_OPENGL_API) != EGL_TRUE) return "no desktop OpenGL";
  constexpr std::array<EGLint, 5> kConfig{EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, 0, EGL_NONE};
  EGLConfig config = nullptr;  // the same as EGL_NO_CONFIG_KHR
  EGLint configs = 0;
  if (eglChooseConfig(display, kConfig.data(), &config, 1, &configs) != EGL_TRUE || configs == 0) {
    config = nullptr;
    if (!has_word(extensions, "EGL_KHR_no_config_context")) return "no configuration for OpenGL";
  }
  constexpr std::array<EGLint, 7> kVersion{
      EGL_CONTEXT_MAJOR_VERSION_KHR,           4,       EGL_CONTEXT_MINOR_VERSION_KHR, 5, EGL_CONTEXT_OPENGL_PROFILE_MASK_KHR,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT_KHR, EGL_NONE};
  const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, kVersion.data());
  if (context == EGL_NO_CONTEXT) return "no OpenGL 4.5 core context, " + error_name(eglGetError());
  if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) != EGL_TRUE) {
    const std::string why_not = "the context cannot be made current, " + error_name(eglGetError());
    eglDestroyContext(display, context);
    return why_not;
  }
  // The shaders read storage buffers in both stages. OpenGL 4.5 does not guarantee any for the vertex stage.
  GLint blocks = 0;
  glGetIntegerv(GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS, &blocks);
  const auto* const renderer = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  const std::string_view name = renderer == nullptr ? "" : renderer;
  is_software_ = name.find("llvmpipe") != std::string_view::npos || name.find("softpipe") != std::string_view::npos ||
                 name.find("SwiftShader") != std::string_view::npos;
  std::string why_not;
  if (name.empty() || blocks < 4) {
    why_not = "its vertex shaders cannot read buffers";
  } else if (allowed == EglDevices::software && !is_software_) {
    why_not = std::string(name) + " is not a software device";
  }
  if (!why_not.empty()) {
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(display, context);
    return why_not;
  }
  display_ = display;
  context_ = context;
  GLint gl_major = 0;
  GLint gl_minor = 0;
  glGetIntegerv(GL_MAJOR_VERSION, &gl_major);
  glGetIntegerv(GL_MINOR_VERSION, &gl_minor);
  description_ = std::string(name) + ", OpenGL " + std::to_string(gl_major) + '.' + std::to_string(gl_minor);
  return {};
}

EglContext::~EglContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  eglReleaseThread();
}

}  // namespace flockstep::render
