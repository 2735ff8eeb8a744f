// EglContext: an OpenGL 4.5 core context without any surface, current on the thread that made it.
#pragma once

#include <stdexcept>
#include <string>

namespace flockstep::render {

// There is no EGL, or it has no device that renders, or one failed on the way. what() says which and why.
class GlUnavailable : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Which devices may be used, as the environment variable FLOCKSTEP_EGL says.
enum class EglDevices {
  any,       // not set, or empty
  none,      // "none": as if EGL was not installed
  software,  // "software": only those that render on the processor
};
EglDevices egl_devices();  // throws GlUnavailable on any other value

// Of the process that makes the first one, alone: what a fork leaves of OpenGL does not work. Takes the first that works of: the
// CUDA devices that CUDA_VISIBLE_DEVICES names, in its order; other hardware; Mesa's software device; Mesa's surfaceless
// platform. Displays are the process's, shared with other libraries in it, and never terminated.
class EglContext {
 public:
  explicit EglContext(EglDevices allowed);  // throws GlUnavailable, with all that was tried
  ~EglContext();                            // on the same thread
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  const std::string& description() const { return description_; }
  bool is_software() const { return is_software_; }

 private:
  bool try_display(void* display, EglDevices allowed, std::string& why_not);

  void* display_ = nullptr;
  void* context_ = nullptr;
  std::string description_;
  bool is_software_ = false;
};

}  // namespace flockstep::render
