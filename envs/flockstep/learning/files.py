"""Files of models: JSON and raw arrays in a zip archive, which also holds checksums. Nothing in them is run."""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

FORMAT = "flockstep model 1"
_TEXT = "model.json"
_TYPES = {"parameters": "<f4", "adam_first": "<f4", "adam_second": "<f4"}  # others are <f8
_MOST_BYTES = 1 << 31  # of the unpacked text or an array


def save(path: str | PathLike[str], state: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write a model. An earlier file of the name stays whole until the new one is complete."""
    target = _with_suffix(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        sizes = {name: int(array.size) for name, array in arrays.items()}
        text = json.dumps({"format": FORMAT, **state, "arrays": sizes}, indent=1, allow_nan=True)
        archive.writestr(_TEXT, text)
        for name, array in arrays.items():
            archive.writestr(name, np.ascontiguousarray(array, _TYPES.get(name, "<f8")).tobytes())
    written = target.with_name(f"{target.name}.{os.getpid()}.part")
    written.write_bytes(content.getvalue())
    written.replace(target)


def load(path: str | PathLike[str]) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Read a model.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        The file is of another kind or damaged.
    """
    source = Path(fspath(path))
    source = source if source.is_file() else _with_suffix(path)
    if not source.is_file():
        raise FileNotFoundError(f"expected a model that PPO.save wrote, got {source}, which is not there")
    try:
        with zipfile.ZipFile(source) as archive:
            if "data" in archive.namelist():
                raise ValueError(
                    f"{source}: it is a model of Stable-Baselines3: load it there, then call flockstep.PPO.from_sb3"
                )
            state = json.loads(_member(archive, _TEXT).decode())
            if not isinstance(state, dict) or state.get("format") != FORMAT:
                raise ValueError(f"expected the format {FORMAT!r}")
            arrays = {}
            for name, size in state["arrays"].items():
                array = np.frombuffer(_member(archive, name), _TYPES.get(name, "<f8"))
                if array.size != size:
                    raise ValueError(f"expected {size} numbers of {name}, got {array.size}")
                arrays[name] = array.astype(array.dtype.newbyteorder("="))
    except (
        zipfile.BadZipFile,
        zlib.error,
        KeyError,
        TypeError,
        AttributeError,
        UnicodeDecodeError,
        OSError,
        NotImplementedError,
        RuntimeError,
        json.JSONDecodeError,
    ) as error:
        raise ValueError(
            f"{source}: expected a model that PPO.save wrote; it is damaged or of another kind ({error})"
        ) from error
    return state, arrays


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    info = archive.getinfo(name)
    if info.file_size > _MOST_BYTES:
        raise ValueError(f"{name}: expected at most {_MOST_BYTES} bytes, got {info.file_size}")
    return archive.read(info)


def _with_suffix(path: str | PathLike[str]) -> Path:
    plain = Path(fspath(path))
    return plain if plain.suffix == ".zip" else plain.with_name(plain.name + ".zip")


def plain_space(space: spaces.Space[Any]) -> dict[str, Any]:
    """Return a space as JSON has it."""
    if isinstance(space, spaces.Dict):
        return {"dict": {name: plain_space(part) for name, part in space.spaces.items()}}
    if isinstance(space, spaces.Discrete):
        return {"discrete": int(space.n), "start": int(space.start)}
    assert isinstance(space, spaces.Box)
    return {
        "box": list(space.shape),
        "dtype": np.dtype(space.dtype).name,
        "low": _bounds(space.low),
        "high": _bounds(space.high),
    }


def _bounds(values: npt.NDArray[Any]) -> list[float]:
    flat = values.ravel()
    return [float(flat[0])] if flat.size and (flat == flat[0]).all() else [float(value) for value in flat]


def space_from(plain: Any) -> spaces.Space[Any]:
    """Return a space from JSON.

    Raises
    ------
    ValueError
        It is not a space.
    """
    try:
        if "dict" in plain:
            return spaces.Dict({str(name): space_from(part) for name, part in plain["dict"].items()})
        if "discrete" in plain:
            return spaces.Discrete(int(plain["discrete"]), start=int(plain["start"]))
        shape = tuple(int(size) for size in plain["box"])
        dtype = np.dtype(plain["dtype"])
        if dtype.kind not in "fiub":
            raise ValueError(f"dtype: expected numbers, got {dtype}")
        low, high = (
            np.broadcast_to(np.asarray(plain[side], dtype), int(np.prod(shape))).reshape(shape)
            for side in ("low", "high")
        )
        return spaces.Box(low, high, shape, dtype.type)
    except (KeyError, TypeError, AttributeError, AssertionError, OverflowError) as error:
        raise ValueError(f"expected a space, got {plain!r} ({error})") from error
