// The version of flockstep, defined only here. CMakeLists.txt and pyproject.toml read it.
#pragma once

// Version of the engine and of these headers.
#define FLOCKSTEP_VERSION "0.1.0"
