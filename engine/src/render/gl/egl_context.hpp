// EglContext: an OpenGL 4.5 core context without a surface, current on the thread that created it.
#pragma once

#include <stdexcept>
#include <string>

namespace flockstep::render {

// Thrown if EGL is missing, if it has no device that renders, or if a device fails while rendering. what() gives the case and
// the reason.
class GlUnavailable : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Devices that may be used, selected by the environment variable FLOCKSTEP_EGL.
enum class EglDevices {
  any,       // variable unset or empty
  none,      // "none": as if EGL were not installed
  software,  // "software": only devices that render on the CPU
};
EglDevices egl_devices();  // throws GlUnavailable on any other value

// Works only in the process that created the first context, since OpenGL does not survive a fork. Tries these devices and
// takes the first that works: the CUDA devices in the order of CUDA_VISIBLE_DEVICES, other hardware, Mesa's software device,
// and Mesa's surfaceless platform. Displays belong to the process and are shared with other libraries, so they are never
// terminated.
class EglContext {
 public:
  explicit EglContext(EglDevices allowed);  // throws GlUnavailable, which lists all attempts
  ~EglContext();                            // call it on the same thread
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  const std::string& description() const { return description_; }
  bool is_software() const { return is_software_; }

 private:
  std::string try_display(void* display, EglDevices allowed);  // returns why it does not work; empty: it does

  void* display_ = nullptr;
  void* context_ = nullptr;
  std::string description_;
  bool is_software_ = false;
};

}  // namespace flockstep::render
