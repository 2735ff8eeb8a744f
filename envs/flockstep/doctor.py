"""Report what flockstep finds on this machine, and what is missing: ``flockstep doctor``."""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from flockstep import _core

#: Packages required to import flockstep: the name for pip and the name for Python.
_REQUIRED = (("numpy", "numpy"), ("gymnasium", "gymnasium"))

#: Optional packages: the name for pip, the name for Python, and the purpose.
_OPTIONAL = (
    ("stable-baselines3", "stable_baselines3", "training"),
    ("torch", "torch", "neural networks for training"),
    ("tqdm", "tqdm", "progress bars"),
    ("protobuf", "google.protobuf", "connecting to servers"),
    ("websockets", "websockets", "connecting to servers, live views"),
    ("pillow", "PIL", "pictures"),
    ("imageio-ffmpeg", "imageio_ffmpeg", "films"),
    ("moviepy", "moviepy", "films by Gymnasium's recorders"),
    ("fast-simplification", "fast_simplification", "meshes of drones"),
    ("scipy", "scipy", "hulls of meshes, identification"),
    ("mcap-ros2-support", "mcap_ros2", "MCAP files"),
    ("onnx", "onnx", "policies as ONNX files"),
    ("matplotlib", "matplotlib", "plots"),
    ("tensorboard", "tensorboard", "learning curves"),
)


def version_of(package: str) -> str | None:
    """Return the version of an installed package, or None."""
    import importlib.metadata  # takes as long as a third of flockstep

    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def state_of(package: str, module: str, purpose: str) -> str:
    """Return a package's version if it can be imported, otherwise the reason why not and the command that fixes it."""
    version = version_of(package)
    if version is None:
        return f"missing ({purpose}): pip install {package}"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            importlib.import_module(module)
    except Exception as error:  # a package may raise anything when it is imported
        reason = " ".join(str(error).split())
        advice = f"pip install --force-reinstall {package}"
        return f"{version}, but importing it raises {type(error).__name__}: {reason} ({purpose}): {advice}"
    return version


def required() -> list[tuple[str, str]]:
    """Return the name and state of each required package."""
    return [(package, state_of(package, module, "needed by flockstep")) for package, module in _REQUIRED]


def stop_without_required() -> None:
    """If NumPy or Gymnasium cannot be imported and this is ``flockstep doctor``, print a report and exit.

    Called at the start of ``import flockstep``. While Python looks for the module of ``-m``, `sys.argv` begins with
    ``"-m"``.
    """
    if os.path.basename(sys.argv[0]) not in ("-m", "flockstep") or sys.argv[1:2] != ["doctor"]:
        return
    found = required()
    if any(state != version_of(package) for package, state in found):
        lines = [*python_and_system(), *found, ("simulator", "cannot be imported without these packages")]
        print_lines(lines, "--json" in sys.argv)
        sys.exit(1)


def dot() -> _core.World:
    """Return a small world."""
    from flockstep import _core

    room = {"min": [0, 0, 0], "max": [1, 1, 1]}
    return _core.World.from_dict({"flockstep_scene": 1, "name": "dot", "room": room})


def opengl() -> str:
    """Return the device on which the camera backend ``gl`` renders, or the reason why there is none."""
    from flockstep import _core

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        batch = _core.Batch([dot()], cameras=[_core.CameraConfig()], camera_backend="gl")
    return f"not available: {caught[0].message}" if caught else f"available: {batch.camera_backend_report()}"


def python_and_system() -> list[tuple[str, str]]:
    """Return the Python version and the operating system."""
    libc = " ".join(platform.libc_ver())
    return [
        ("Python", f"{platform.python_version()}, {sys.executable}"),
        ("system", f"{platform.platform()}{f', {libc}' if libc.strip() else ''}"),
    ]


def report() -> list[tuple[str, str]]:
    """Return the lines of the report: what was checked and what was found, in printing order."""
    from flockstep import _core

    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    lines = [
        ("flockstep", f"{_core.__version__}, in {os.path.dirname(_core.__file__)}"),
        *python_and_system(),
        *required(),
        ("processors", f"{processors}; a batch of many drones uses {_core.Batch([dot()], 10_000).num_threads} threads"),
        ("SIMD", f"{_core.simd_target.replace('AVX3', 'AVX-512')}, chosen at run time"),
        ("camera backend raycast", f"available: Embree {_core.embree_version}"),
        ("camera backend gl", opengl()),
    ]
    return [*lines, *((package, state_of(package, module, purpose)) for package, module, purpose in _OPTIONAL)]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``doctor``."""
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=lambda arguments: print_lines(report(), arguments.json))


def main() -> None:
    """Print the report."""
    print_lines(report())


def print_lines(lines: list[tuple[str, str]], as_json: bool = False) -> None:
    """Print names and findings in two columns, or as one JSON object."""
    if as_json:
        print(json.dumps(dict(lines)))
        return
    width = max(len(name) for name, _ in lines)
    for name, found in lines:
        print(f"{name:<{width}}  {found}")
