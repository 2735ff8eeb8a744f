#include "imaging/opencv.hpp"

// OpenCV's core looks up OpenGL functions through this function, in code that we never call. Our hidden definition lets us
// link without libGLX. A lookup would fail as it does on a machine without OpenGL.
extern "C" void* glXGetProcAddressARB(const unsigned char* name);
extern "C" void* glXGetProcAddressARB(const unsigned char* /*name*/) { return nullptr; }

namespace flockstep::imaging {

void prepare_opencv() {
  static const bool done = [] {
    cv::setNumThreads(0);
    return true;
  }();
  static_cast<void>(done);
}

}  // namespace flockstep::imaging
