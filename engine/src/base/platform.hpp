// What differs between operating systems.
#pragma once

#include <optional>
#include <string>

namespace flockstep {

// Whether the processor has the instructions that the engine is compiled for: on x86-64 those of x86-64-v2, with SSE4.2.
bool has_instructions();

long process_id();

// Physical cores among the processors this process may run on; at least 1.
int physical_cores();

// Processors this process may run on; at least 1.
int logical_processors();

// The memory of the machine, in bytes; 0 where it cannot be told.
double physical_memory();

// How much more address space this process may take, in bytes; infinity where nothing limits it (ulimit -v).
double address_space_left();

// Hands the memory that has been freed back to the system, which the allocator keeps otherwise: some milliseconds, for when much
// has been.
void give_back_freed_memory();

// Loads EGL and OpenGL for as long as the process lives. Returns why they cannot be, or nothing.
std::string gl_load_error();

// The text that a shared library exports under this name, a `const char name[]`; nothing if it exports none. Where libraries are
// ELF files it is read from the file, and nothing of the library runs. Throws std::invalid_argument if the file is not a whole
// shared library: a system may end the process that loads part of one.
std::optional<std::string> exported_text(const std::string& library, const char* name);

// A function of a shared library, which stays loaded for as long as the process lives. Throws std::invalid_argument where there
// is no such library or function.
void* load_function(const std::string& library, const char* name);

}  // namespace flockstep
