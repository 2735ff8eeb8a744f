// The version of the engine; set once, in pyproject.toml.
#pragma once

#ifndef SWIFTLET_VERSION
#define SWIFTLET_VERSION "0.0.0"
#endif
