// Handing memory from thread to thread through a library without instrumentation (oneTBB, Embree): the thread sanitizer does not
// see how it synchronises and would call every such access a race. These tell it, and do nothing in other builds. What is
// released at an address before is seen by whoever acquires there after.
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
