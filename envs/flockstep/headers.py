"""The folder of the C++ headers."""

from __future__ import annotations

from pathlib import Path


def include_dir() -> Path:
    """Return the folder of the C++ headers that a `NativeTask` is built against. They include Eigen's headers too."""
    package = Path(__file__).resolve().parent
    installed = package / "include"
    return installed if installed.is_dir() else package.parents[1] / "engine" / "include"
