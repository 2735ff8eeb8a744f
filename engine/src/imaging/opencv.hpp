// The only file that includes OpenCV, and only its core and imgproc. CMake links its static libraries; see
// cmake/Dependencies.cmake.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace flockstep::imaging {

// Keeps OpenCV from starting threads; call it before any OpenCV function. Our copy of OpenCV is linked statically with hidden
// symbols, so the setting does not affect other copies in the process, such as the one in the Python module cv2.
void prepare_opencv();

}  // namespace flockstep::imaging
