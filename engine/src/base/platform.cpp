#include "base/platform.hpp"

#include <algorithm>
#include <atomic>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>

#if defined(_WIN32)
#include <process.h>
#include <windows.h>
#else
#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>
#endif
#if defined(__linux__)
#include <malloc.h>
#include <sched.h>
#include <sys/resource.h>

#include <fstream>
#include <set>
#endif

namespace flockstep {

#if defined(__x86_64__)
bool has_instructions() { return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt"); }
#else
bool has_instructions() { return true; }
#endif

#if defined(_WIN32)
long process_id() { return _getpid(); }
double physical_memory() {
  MEMORYSTATUSEX status{};
  status.dwLength = sizeof(status);
  return GlobalMemoryStatusEx(&status) ? static_cast<double>(status.ullTotalPhys) : 0.0;
}
#else
// Kept until a fork, since every call on a batch wants it and a system call costs as much as a step of four envs.
long process_id() {
  static std::atomic<long> kept{0};
  static const bool is_told_of_forks = pthread_atfork(nullptr, nullptr, [] { kept.store(0, std::memory_order_relaxed); }) == 0;
  if (const long id = kept.load(std::memory_order_relaxed); id != 0) return id;
  const long id = static_cast<long>(getpid());
  if (is_told_of_forks) kept.store(id, std::memory_order_relaxed);
  return id;
}
double physical_memory() {
  const long pages = sysconf(_SC_PHYS_PAGES);
  const long bytes = sysconf(_SC_PAGESIZE);
  return pages > 0 && bytes > 0 ? static_cast<double>(pages) * static_cast<double>(bytes) : 0.0;
}
#endif

namespace {

// Loads a shared library for as long as the process lives. Returns why it cannot be, or nothing.
#if defined(_WIN32)
constexpr const char* kEgl = "libEGL.dll";
constexpr const char* kOpenGl[] = {"opengl32.dll"};
std::string load_error(const char* library) {
  return LoadLibraryA(library) != nullptr ? std::string() : std::string(library) + " cannot be loaded";
}
#else
constexpr const char* kEgl = "libEGL.so.1";
constexpr const char* kOpenGl[] = {"libOpenGL.so.0", "libGL.so.1"};
std::string load_error(const char* library) {
  if (dlopen(library, RTLD_LAZY | RTLD_LOCAL) != nullptr) return {};
  const char* why = dlerror();
  return why != nullptr ? why : std::string(library) + " cannot be loaded";
}
#endif

}  // namespace

std::string gl_load_error() {
  std::string why = load_error(kEgl);
  if (why.empty()) {
    for (const char* library : kOpenGl) {
      why = load_error(library);
      if (why.empty()) return {};
    }
  }
  return "OpenGL without a screen is not installed (on Debian and Ubuntu: apt install libegl1 libgl1): " + why;
}

void* load_function(const std::string& library, const char* name) {
#if defined(_WIN32)
  const HMODULE module = LoadLibraryA(library.c_str());
  void* const function = module != nullptr ? reinterpret_cast<void*>(GetProcAddress(module, name)) : nullptr;
  const std::string why = "it cannot be loaded";
#else
  void* const module = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  void* const function = module != nullptr ? dlsym(module, name) : nullptr;
  const char* const error = function == nullptr ? dlerror() : nullptr;
  const std::string why = error != nullptr ? error : "it is not there";
#endif
  if (function == nullptr) {
    throw std::invalid_argument("path: expected a shared library that exports " + std::string(name) + ", got '" + library +
                                "' (" + why + ")");
  }
  return function;
}

void give_back_freed_memory() {
#if defined(__GLIBC__)
  malloc_trim(0);
#endif
}

int logical_processors() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

#if defined(__linux__)
double address_space_left() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return std::numeric_limits<double>::infinity();
  std::ifstream file("/proc/self/statm");
  double pages = 0.0;  // in use
  file >> pages;
  return static_cast<double>(limit.rlim_cur) - pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

int physical_cores() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (sched_getaffinity(0, sizeof(allowed), &allowed) != 0) {
    return logical_processors();
  }
  std::set<std::string> cores;  // siblings of one core name the same list
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
    if (!CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) continue;
    const std::string number = std::to_string(cpu);
    std::ifstream file("/sys/devices/system/cpu/cpu" + number + "/topology/thread_siblings_list");
    std::string siblings;
    cores.insert(std::getline(file, siblings) ? siblings : number);
  }
  return std::max(1, static_cast<int>(cores.size()));
}
#else
double address_space_left() { return std::numeric_limits<double>::infinity(); }
int physical_cores() { return logical_processors(); }
#endif

}  // namespace flockstep
