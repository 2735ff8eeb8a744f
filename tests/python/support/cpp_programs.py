"""Installs the C++ libraries, and builds programs with them outside the checkout."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

BUILD = ROOT / "build" / "release"
COMPILERS = ("g++", "clang++")
#: GCC before 14 warns about fields with defaults that designated initializers omit.
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-missing-field-initializers")
TARGETS = {"library": "flockstep", "client": "flockstep_client"}
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="reads ELF files")


def run(*command: object, **options: object) -> str:
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def install(folder: Path, *components: str) -> Path:
    """Build and install components into a prefix, which is moved after the installation."""
    run("cmake", "--build", BUILD, "--target", *(TARGETS[component] for component in components))
    for component in components:
        run("cmake", "--install", BUILD, "--component", component, "--prefix", folder / "built")
    return (folder / "built").rename(folder / "moved")


def configure(folder: Path, compiler: str, *options: str) -> None:
    """Build the project of a folder in its subfolder build/, with warnings as errors."""
    flags = f"-DCMAKE_CXX_FLAGS={' '.join(WARNINGS)}"
    run(
        "cmake",
        "-S",
        folder,
        "-B",
        folder / "build",
        "-G",
        "Ninja",
        f"-DCMAKE_CXX_COMPILER={compiler}",
        flags,
        *options,
    )
    run("cmake", "--build", folder / "build")


def exported(library: Path) -> list[str]:
    """Return the symbols that an ELF library exports."""
    return [line.split(" ", 2)[2] for line in run("nm", "-DC", "--defined-only", library).splitlines()]
