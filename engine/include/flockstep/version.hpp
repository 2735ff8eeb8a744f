// The version of the engine; set once, in pyproject.toml.
#pragma once

#ifndef FLOCKSTEP_VERSION
#define FLOCKSTEP_VERSION "0.0.0"
#endif
