// What differs between operating systems.
#pragma once

namespace swiftlet {

long process_id();

// Physical cores among the processors this process may run on; at least 1.
int physical_cores();

}  // namespace swiftlet
