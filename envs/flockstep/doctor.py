"""What this machine has for flockstep, and what it lacks: ``python -m flockstep doctor``."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
import warnings

from flockstep import _core

#: Packages that are not needed to fly, and what for.
_OPTIONAL = (
    ("stable-baselines3", "training"),
    ("torch", "the networks of that"),
    ("tqdm", "progress bars"),
    ("pillow", "pictures"),
    ("imageio-ffmpeg", "films"),
    ("moviepy", "films by Gymnasium's recorders"),
    ("fast-simplification", "meshes of drones"),
    ("scipy", "hulls of these"),
    ("matplotlib", "plots"),
    ("tensorboard", "curves of a training"),
)


def version_of(package: str) -> str | None:
    """Return the version of an installed package, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def dot() -> _core.World:
    """Return a small world."""
    room = {"min": [0, 0, 0], "max": [1, 1, 1]}
    return _core.World.from_dict({"flockstep_scene": 1, "name": "dot", "room": room})


def opengl() -> str:
    """Return which device the camera backend ``gl`` renders on, or why there is none."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        batch = _core.Batch([dot()], cameras=[_core.CameraConfig()], camera_backend="gl")
    return f"not here: {caught[0].message}" if caught else f"here: {batch.camera_backend_report()}"


def report() -> list[tuple[str, str]]:
    """Return what is looked at, and what was found, in the order in which it is printed."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    libc = " ".join(platform.libc_ver())
    lines = [
        ("flockstep", f"{_core.__version__}, in {os.path.dirname(_core.__file__)}"),
        ("Python", f"{platform.python_version()}, {sys.executable}"),
        ("system", f"{platform.platform()}{f', {libc}' if libc.strip() else ''}"),
        ("NumPy, Gymnasium", f"{version_of('numpy')}, {version_of('gymnasium')}"),
        ("processors", f"{processors}; a batch of many drones uses {_core.Batch([dot()], 10_000).num_threads} threads"),
        ("SIMD", f"{_core.simd_target}, chosen at run time"),
        ("camera backend raycast", f"here: Embree {_core.embree_version}"),
        ("camera backend gl", opengl()),
    ]
    for package, purpose in _OPTIONAL:
        version = version_of(package)
        lines.append((package, version if version is not None else f"missing ({purpose}): pip install {package}"))
    return lines


def main() -> None:
    """Print the report."""
    lines = report()
    width = max(len(name) for name, _ in lines)
    for name, found in lines:
        print(f"{name:<{width}}  {found}")
