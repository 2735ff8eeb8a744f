// Annotations for memory that is passed between threads through uninstrumented libraries (oneTBB, Embree). The thread sanitizer
// cannot observe their synchronization and would report each such access as a race. A release at an address happens before a
// later acquire at the same address. In other builds these functions do nothing.
#pragma once

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define FLOCKSTEP_THREAD_SANITIZER
#endif
#endif
#if defined(__SANITIZE_THREAD__)
#define FLOCKSTEP_THREAD_SANITIZER
#endif

#if defined(FLOCKSTEP_THREAD_SANITIZER)
#include <sanitizer/tsan_interface.h>
// A function whose reads and writes are not checked; those of the functions that it calls are.
#define FLOCKSTEP_UNCHECKED_BY_THREAD_SANITIZER __attribute__((no_sanitize("thread")))
#else
#define FLOCKSTEP_UNCHECKED_BY_THREAD_SANITIZER
#endif

namespace flockstep::thread_sanitizer {

#if defined(FLOCKSTEP_THREAD_SANITIZER)
inline void release(const void* at) { __tsan_release(const_cast<void*>(at)); }
inline void acquire(const void* at) { __tsan_acquire(const_cast<void*>(at)); }
#else
inline void release(const void*) {}
inline void acquire(const void*) {}
#endif

}  // namespace flockstep::thread_sanitizer
