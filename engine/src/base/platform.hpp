// What differs between operating systems.
#pragma once

#include <string>

namespace flockstep {

long process_id();

// Physical cores among the processors this process may run on; at least 1.
int physical_cores();

// Loads EGL and OpenGL for as long as the process lives. Returns why they cannot be, or nothing.
std::string gl_load_error();

}  // namespace flockstep
