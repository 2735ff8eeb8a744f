// The one place that includes OpenCV: only its core and imgproc. CMake links its static libraries, see cmake/Dependencies.cmake.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace flockstep::imaging {

// Keeps OpenCV from starting threads; to be called before any of its functions. Our copy of OpenCV is linked
// statically and its symbols are hidden, so the setting does not reach another copy in the process, such as that of the Python
// module cv2.
void prepare_opencv();

}  // namespace flockstep::imaging
