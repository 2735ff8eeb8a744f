"""The bundled scenes: their names, the named sets and their location."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from flockstep import _core
from flockstep._core import World

#: One world: the object, its name or its path.
WorldLike: TypeAlias = World | str | PathLike[str]
#: One world, the name of a set such as ``"train"``, or a sequence of these.
WorldsLike: TypeAlias = WorldLike | Sequence[WorldLike]

#: Set names and the scenes in each set.
SETS: dict[str, tuple[str, ...]] = _core.scene_sets

#: Functions that make the scenes without a file.
GENERATED: dict[str, Callable[[], World]] = {
    name: partial(_core.load_scene, name, "") for name in _core.generated_scenes
}

#: Generators of seeded scenes such as ``"forest/seed-7"``: the word before the seed.
GENERATORS: tuple[str, ...] = _core.scene_generators

_SEEDED = re.compile(r"(\w+)/seed-(\d{1,18})(?:\.\.(\d{1,18}))?")
_BUNDLED = re.compile(r"[\w-]+/[\w-]+")  # a folder and a file without its suffix
_MOST_SEEDS = 100_000  # in one range


def directory() -> Path:
    """Return the folder of the bundled scenes, inside an installed package or at the root of a checkout."""
    package = Path(__file__).resolve().parent
    installed = package / "scenes"
    return installed if installed.is_dir() else package.parents[1] / "scenes"


def names() -> list[str]:
    """Return the names of the bundled scenes, sorted, such as ``"playground/train-1"``."""
    root = directory()
    return sorted([*(p.relative_to(root).with_suffix("").as_posix() for p in root.glob("*/*.json")), *GENERATED])


def find(source: str | PathLike[str]) -> Path | World:
    """Return the file of a scene, or the world itself if it is generated.

    Parameters
    ----------
    source
        A bundled name such as ``"playground/train-1"``, a generator and its seed such as ``"forest/seed-7"``, or the
        path of a ``.json``, ``.gltf``, ``.glb``, ``.obj`` or ``.ply`` file.

    Raises
    ------
    FileNotFoundError
        The path's file does not exist.
    ValueError
        The source is neither a bundled name nor a path; the message suggests similar names.
    """
    if isinstance(source, str) and source in GENERATED:
        return GENERATED[source]()
    if isinstance(source, str) and (seeded := _SEEDED.fullmatch(source)) and seeded[1] in GENERATORS and not seeded[3]:
        return _core.load_scene(source, "")
    path = Path(source)
    if path.suffix.lower() in _core.scene_suffixes:
        if not path.is_file():
            raise FileNotFoundError(f"no such scene file: {path}")
        return path
    if isinstance(source, str) and _BUNDLED.fullmatch(source) and (file := directory() / f"{source}.json").is_file():
        return file
    raise ValueError(_core._unknown_scene(str(source), names()))


def load(worlds: WorldsLike) -> list[World]:
    """Return the worlds for a set name, a scene name, a path, a `World`, or a sequence of these.

    A scene named more than once is loaded once and shared. ``"forest/seed-0..99"`` stands for a hundred scenes.

    Raises
    ------
    FileNotFoundError
        A path's file does not exist.
    ValueError
        An unknown name, an empty sequence, or a scene file with a mistake in it.
    TypeError
        An element is neither a world nor a name or path.
    """
    if not isinstance(worlds, (str, PathLike, World, Sequence)):
        raise TypeError(f"worlds: expected a name, a path, a World or a sequence of these, got {worlds!r}")
    sources = [worlds] if isinstance(worlds, (str, PathLike, World)) else list(worlds)
    if not sources:
        raise ValueError("worlds: expected at least one, got an empty sequence")
    loaded: dict[Any, World] = {}
    result = []
    for source in sources:
        if isinstance(source, World):
            result.append(source)
            continue
        if not isinstance(source, (str, PathLike)):
            raise TypeError(f"worlds: expected a name, a path or a World, got {type(source).__name__}")
        members = (SETS.get(source) or _seeded(source) or (source,)) if isinstance(source, str) else (source,)
        for member in members:
            key = member if member in GENERATED or _seeded(member) else find(member)
            if key not in loaded:
                loaded[key] = World.load(str(key))
            result.append(loaded[key])
    return result


def load_one(world: WorldLike) -> World:
    """Return the world for a `World`, a scene name or a path.

    Raises
    ------
    ValueError
        The argument stands for several worlds. Otherwise as in `load`.
    """
    loaded = load(world)
    if len(loaded) != 1:
        raise ValueError(f"world: expected one world, got {len(loaded)} ({world!r})")
    return loaded[0]


def _seeded(source: object) -> tuple[str, ...]:
    """Return the names of the generated scenes for a name with a seed or a range of seeds."""
    match = _SEEDED.fullmatch(source) if isinstance(source, str) else None
    if match is None or match[1] not in GENERATORS:
        return ()
    first, last = int(match[2]), int(match[3] or match[2])
    if not first <= last < first + _MOST_SEEDS:
        raise ValueError(f"{source!r}: expected a range of 1 to {_MOST_SEEDS} seeds")
    return tuple(f"{match[1]}/seed-{seed}" for seed in range(first, last + 1))
