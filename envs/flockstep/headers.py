"""Folders needed to build C++ code."""

from __future__ import annotations

from pathlib import Path

from flockstep import _core


def include_dir() -> Path:
    """Return the folder of the C++ headers for building a `NativeTask`; Eigen's headers are included."""
    package = Path(__file__).resolve().parent
    installed = package / "include"
    return installed if installed.is_dir() else package.parents[1] / "engine" / "include"


def cmake_dir() -> Path:
    """Return the folder in which CMake's ``find_package(flockstep)`` finds ``flockstep::task``, for a `NativeTask`."""
    return Path(_core.__file__).resolve().parent / "cmake"  # an editable install has it only beside the module
