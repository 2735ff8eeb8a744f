// EglContext: an OpenGL 4.5 core context without any surface, current on the thread that made it.
#pragma once

#include <stdexcept>
#include <string>

namespace flockstep::render {

// There is no EGL, or it has no device that renders, or a device failed while it rendered. what() says which and why.
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

// Works only in the process that made the first one, since OpenGL does not survive a fork. Tries the CUDA devices that
// CUDA_VISIBLE_DEVICES names, in its order, then other hardware, Mesa's software device and Mesa's surfaceless platform, and
// takes the first that works. Displays belong to the process, which shares them with other libraries; they are never terminated.
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
