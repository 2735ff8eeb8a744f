#include "base/platform.hpp"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "base/require.hpp"

#if defined(_WIN32)
#include <process.h>
#include <windows.h>
#else
#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>
#endif
#if defined(__linux__)
#include <elf.h>
#include <malloc.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <set>
#endif
#if defined(__SSE__) || defined(_M_X64)
#include <xmmintrin.h>
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
// Cached until a fork, because every call on a batch needs it and a system call costs as much as a step of four envs.
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

// Loads a shared library and never unloads it. Returns the error, or an empty string.
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
  return "headless OpenGL is not installed (on Debian and Ubuntu: apt install libegl1 libgl1): " + why;
}

namespace {

[[noreturn]] void refuse_library(const std::string& library, const std::string& why) {
  refuse("path", "a shared library", '\'' + library + "' (" + why + ')');
}

// The system searches a name without a folder in its library path, hence the absolute path.
std::string absolute(const std::string& library) { return std::filesystem::absolute(library).string(); }

void require_regular_file(const std::string& library) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(library, error);
  if (!std::filesystem::exists(status)) throw MissingFile("no such shared library: '" + library + '\'');
  if (!std::filesystem::is_regular_file(status)) refuse_library(library, "not a regular file");
}

#if defined(__linux__)
// Reads parts of an ELF file.
class ElfFile {
 public:
  explicit ElfFile(const std::string& library) : library_(library), file_(library, std::ios::binary | std::ios::ate) {
    if (!file_) refuse_library(library_, "the file cannot be read");
    size_ = static_cast<std::uint64_t>(file_.tellg());
  }

  std::uint64_t size() const { return size_; }

  // Throws if the range is not entirely within the file.
  template <class T>
  std::vector<T> read(std::uint64_t offset, std::uint64_t count) {
    if (count > size_) refuse_library(library_, "the file is truncated");
    require_whole(offset, count * sizeof(T));
    std::vector<T> values(count);
    file_.seekg(static_cast<std::streamoff>(offset));
    file_.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)));
    if (!file_) refuse_library(library_, "the file cannot be read");
    return values;
  }
  void require_whole(std::uint64_t offset, std::uint64_t bytes) const {
    if (offset > size_ || bytes > size_ - offset) refuse_library(library_, "the file is truncated");
  }

 private:
  std::string library_;
  std::ifstream file_;
  std::uint64_t size_ = 0;
};

// Returns the text at a symbol's address.
std::optional<std::string> text_at(ElfFile& file, const std::vector<Elf64_Phdr>& segments, const Elf64_Sym& symbol) {
  for (const Elf64_Phdr& segment : segments) {
    if (segment.p_type != PT_LOAD || symbol.st_value < segment.p_vaddr) continue;
    const std::uint64_t within = symbol.st_value - segment.p_vaddr;
    if (within > segment.p_filesz || symbol.st_size > segment.p_filesz - within) continue;
    const std::vector<char> text = file.read<char>(segment.p_offset + within, symbol.st_size);
    return std::string(text.begin(), std::ranges::find(text, '\0'));
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> exported_text(const std::string& library, const char* name) {
  require_regular_file(library);
  ElfFile file(library);
  constexpr unsigned char kOwnKind[] = {ELFMAG0, ELFMAG1, ELFMAG2, ELFMAG3, ELFCLASS64, ELFDATA2LSB};
  if (file.size() < sizeof(Elf64_Ehdr)) refuse_library(library, "not an ELF file");
  const Elf64_Ehdr header = file.read<Elf64_Ehdr>(0, 1)[0];
  if (!std::equal(std::begin(kOwnKind), std::end(kOwnKind), header.e_ident)) refuse_library(library, "not a 64-bit ELF file");
  if (header.e_type != ET_DYN || header.e_phentsize != sizeof(Elf64_Phdr)) refuse_library(library, "not a shared library");
  const auto segments = file.read<Elf64_Phdr>(header.e_phoff, header.e_phnum);
  for (const Elf64_Phdr& segment : segments) file.require_whole(segment.p_offset, segment.p_filesz);
  if (header.e_shnum == 0 || header.e_shentsize != sizeof(Elf64_Shdr)) return std::nullopt;
  const auto sections = file.read<Elf64_Shdr>(header.e_shoff, header.e_shnum);
  for (const Elf64_Shdr& section : sections) {
    if (section.sh_type != SHT_DYNSYM || section.sh_link >= sections.size()) continue;
    const auto symbols = file.read<Elf64_Sym>(section.sh_offset, section.sh_size / sizeof(Elf64_Sym));
    const Elf64_Shdr& strings = sections[section.sh_link];
    std::vector<char> names = file.read<char>(strings.sh_offset, strings.sh_size);
    names.push_back('\0');
    for (const Elf64_Sym& symbol : symbols) {
      if (symbol.st_shndx == SHN_UNDEF || symbol.st_name >= names.size()) continue;
      if (std::strcmp(names.data() + symbol.st_name, name) == 0) return text_at(file, segments, symbol);
    }
  }
  return std::nullopt;
}
#else
}  // namespace

std::optional<std::string> exported_text(const std::string& library, const char* name) {
  require_regular_file(library);
#if defined(_WIN32)
  const HMODULE module = LoadLibraryA(absolute(library).c_str());
  if (module == nullptr) refuse_library(library, "it cannot be loaded");
  const auto* const text = reinterpret_cast<const char*>(GetProcAddress(module, name));
#else
  void* const module = dlopen(absolute(library).c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (module == nullptr) refuse_library(library, dlerror());
  const auto* const text = static_cast<const char*>(dlsym(module, name));
#endif
  return text != nullptr ? std::optional<std::string>(text) : std::nullopt;
}
#endif

void* load_function(const std::string& library, const char* name) {
#if defined(_WIN32)
  const HMODULE module = LoadLibraryA(absolute(library).c_str());
  void* const function = module != nullptr ? reinterpret_cast<void*>(GetProcAddress(module, name)) : nullptr;
  const std::string why = "it cannot be loaded";
#else
  void* const module = dlopen(absolute(library).c_str(), RTLD_NOW | RTLD_LOCAL);
  void* const function = module != nullptr ? dlsym(module, name) : nullptr;
  const char* const error = function == nullptr ? dlerror() : nullptr;
  const std::string why = error != nullptr ? error : "symbol not found";
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

void prefer_large_pages([[maybe_unused]] void* memory, [[maybe_unused]] std::size_t bytes) {
#if defined(__linux__)
  constexpr std::uintptr_t kPage = std::uintptr_t{2} << 20U;
  const auto first = reinterpret_cast<std::uintptr_t>(memory);
  const std::uintptr_t begin = (first + kPage - 1) / kPage * kPage, end = (first + bytes) / kPage * kPage;
  if (begin < end) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

int logical_processors() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

#if defined(__linux__)
double address_space_left() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return std::numeric_limits<double>::infinity();
  std::ifstream file("/proc/self/statm");
  double pages = 0.0;  // pages in use
  file >> pages;
  return static_cast<double>(limit.rlim_cur) - pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

std::string thread_limits() {
  std::string text;
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
    text = std::to_string(limit.rlim_cur >> 20U) + " MiB of address space (ulimit -v)";
  }
  if (getrlimit(RLIMIT_NPROC, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
    text += (text.empty() ? "" : ", ") + std::to_string(limit.rlim_cur) + " processes (ulimit -u)";
  }
  return text + (text.empty() ? "" : ", ") + "pids.max of the container";
}

int physical_cores() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (sched_getaffinity(0, sizeof(allowed), &allowed) != 0) {
    return logical_processors();
  }
  std::set<std::string> cores;  // hyperthreads of one core have the same list
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
std::string thread_limits() { return "the limits of the system"; }
int physical_cores() { return logical_processors(); }
#endif

#if defined(__SSE__) || defined(_M_X64)
FlushDenormals::FlushDenormals() : saved_(_mm_getcsr()) {
  constexpr unsigned int kFlushToZero = 0x8000;
  constexpr unsigned int kDenormalsAreZero = 0x0040;
  _mm_setcsr(saved_ | kFlushToZero | kDenormalsAreZero);
}
FlushDenormals::~FlushDenormals() { _mm_setcsr(saved_); }
#elif defined(__aarch64__)
FlushDenormals::FlushDenormals() {
  constexpr std::uint64_t kFlushToZero = 1U << 24U;  // applies to operands and results
  std::uint64_t control = 0;
  asm volatile("mrs %0, fpcr" : "=r"(control));
  saved_ = static_cast<unsigned int>(control);
  asm volatile("msr fpcr, %0" : : "r"(control | kFlushToZero));
}
FlushDenormals::~FlushDenormals() { asm volatile("msr fpcr, %0" : : "r"(std::uint64_t{saved_})); }
#else
FlushDenormals::FlushDenormals() : saved_(0) {}
FlushDenormals::~FlushDenormals() = default;
#endif

}  // namespace flockstep
