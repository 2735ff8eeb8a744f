// FLOCKSTEP_API marks the functions and classes that the shared library exports: those with code outside the headers. All other
// symbols stay hidden, so they cannot clash with symbols of a program or of another library, such as Eigen's.
#pragma once

#if !defined(_WIN32)
#define FLOCKSTEP_API __attribute__((visibility("default")))
#elif defined(FLOCKSTEP_IMPORTS)  // set by the CMake target flockstep::flockstep
#define FLOCKSTEP_API __declspec(dllimport)
#elif defined(FLOCKSTEP_EXPORTS)  // set while the engine is built
#define FLOCKSTEP_API __declspec(dllexport)
#else
#define FLOCKSTEP_API
#endif
