// The one place that includes OpenCV: its core and imgproc alone. CMake links its static libraries, see cmake/Dependencies.cmake.
#pragma once

#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wdeprecated-anon-enum-enum-conversion"
#pragma clang diagnostic ignored "-Wdeprecated-enum-enum-conversion"
#elif defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-enum-enum-conversion"
#endif
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#if defined(__clang__)
#pragma clang diagnostic pop
#elif defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

namespace flockstep::imaging {

// Keeps OpenCV from starting threads of its own; to be called before any of its functions. Our copy of OpenCV is linked
// statically and its symbols are hidden, so the setting does not reach another copy in the process, such as that of the Python
// module cv2.
void prepare_opencv();

}  // namespace flockstep::imaging
