// Operating system specifics.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace flockstep {

// Returns whether the processor has the instructions that the engine is compiled for: on x86-64 those of x86-64-v2, including
// SSE4.2.
bool has_instructions();

long process_id();

// Returns the number of physical cores among the processors that this process may run on; at least 1.
int physical_cores();

// Returns the number of processors that this process may run on; at least 1.
int logical_processors();

// Returns the machine's physical memory in bytes; 0 if unknown.
double physical_memory();

// Returns the address space that this process may still allocate, in bytes; infinity if it is not limited (ulimit -v).
double address_space_left();

// Names the limits of the system that can keep this process from starting threads.
std::string thread_limits();

// Returns freed memory, which the allocator otherwise keeps, to the system. It takes some milliseconds, so call it after
// freeing much memory.
void give_back_freed_memory();

// Requests large pages (2 MiB) for memory that is not used yet, so that scattered accesses miss the TLB less often. The request
// covers the pages that lie completely in the memory. Systems may ignore it.
void prefer_large_pages(void* memory, std::size_t bytes);

// Loads EGL and OpenGL and never unloads them. Returns the error, or an empty string.
std::string gl_load_error();

// Returns the text that a shared library exports under this name, a `const char name[]`; nothing if it exports none. On Linux
// the text is read from the ELF file, and no code of the library runs. Throws std::invalid_argument if the file is not a
// complete shared library, because loading a truncated one can crash the process.
std::optional<std::string> exported_text(const std::string& library, const char* name);

// Returns a function of a shared library, which is never unloaded. Throws std::invalid_argument if the library or the function
// does not exist.
void* load_function(const std::string& library, const char* name);

// FlushDenormals: a scope in which a thread treats denormal numbers as zero.
// Treats denormals as zero on this thread for the lifetime of the object. Embree requires this.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned int saved_;
};

}  // namespace flockstep
