// What differs between operating systems.
#pragma once

#include <string>

namespace swiftlet {

long process_id();

// Physical cores among the processors this process may run on; at least 1.
int physical_cores();

// Loads a shared library for as long as the process lives. Returns why it cannot be, or nothing.
std::string load_error(const char* library);

}  // namespace swiftlet
