"""Recordings as MCAP files: a channel for each array, beside the ROS 2 messages of `flockstep.bridges.McapRecorder`.

The topic of an array is ``/flockstep/NAME``. The metadata of its channel are dtype, shape and unit, and a message its
bytes, little-endian. It has no schema: readers of ROS 2 refuse whole files with a schema of an unknown encoding. Images
are messages of ``/flockstep/camera.NAME.jpeg``. The metadata record ``flockstep`` and attachments hold everything else,
before the first message that needs it, so that a file can end anywhere.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from flockstep._core import Batch, Bodies, Contact, DroneModel, World
from flockstep.drone_mesh import DroneMesh
from flockstep.recordings.moment import GATES, Array
from flockstep.recordings.recording import Contents, plain_paths

FORMAT = "1"
_ENCODING = "flockstep"
_TOPIC = "/flockstep/"
_DTYPES = ("<f4", "<f8", "<i4", "<i8", "|b1", "|u1", "<u2", "<u4", "<u8")
_CHUNK_BYTES = 256 * 1024  # a file that is cut short loses at most this much
#: Sizes beyond which a file is refused.
_MOST_CHUNK_BYTES = 1 << 28
_MOST_EXPANSION = 500  # of a file, beside one chunk
_MOST_DRONES = 1 << 20


def require() -> Any:
    """Return the module mcap, or raise ModuleNotFoundError."""
    try:
        import mcap.writer
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "MCAP files need mcap, which is not installed: pip install 'flockstep[mcap]'", name="mcap"
        ) from error
    return mcap.writer


class ArrayChannels:
    """Writes moments with an open writer of the package mcap.

    ``contents`` describes them. Its arrays and images are not written; worlds and bodies are as they appear in it.
    """

    def __init__(self, writer: Any, contents: Contents) -> None:
        self._writer, self._contents = writer, contents
        self._channels: dict[str, tuple[int, str, tuple[int, ...]]] = {}
        self._known: set[str] = set()
        mesh = contents.look
        about = {
            "format": FORMAT,
            "title": contents.title,
            "recipe": contents.recipe,
            "settings": json.dumps(contents.settings),
            "drone": json.dumps(contents.drone.to_dict()),
            "look": json.dumps(None if mesh is None else mesh.to_dict()),
            "repeats_ends": json.dumps(contents.repeats_ends),
        }
        writer.add_metadata("flockstep", about)

    def write(self, time_ns: int, arrays: Mapping[str, Array], images: Mapping[str, Sequence[bytes]]) -> None:
        """Write one moment."""
        for index, world in self._contents.worlds.items():
            self._attach(f"world-{index}.glb", world)
        for number, look in enumerate(self._contents.bodies):
            self._attach(f"body-{number}.glb", look)
        for name, files in images.items():
            for file in files:
                self._add(f"camera.{name}.jpeg", "jpeg", (), "", time_ns, file)
        for name, values in arrays.items():
            kept = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
            unit = self._contents.units.get(name, "")
            self._add(name, kept.dtype.str, kept.shape, unit, time_ns, kept.tobytes())

    def _add(self, name: str, dtype: str, shape: tuple[int, ...], unit: str, time_ns: int, data: bytes) -> None:
        if name not in self._channels:
            about = {"dtype": dtype, "shape": json.dumps(shape), "unit": unit}
            self._channels[name] = (self._writer.register_channel(_TOPIC + name, _ENCODING, 0, about), dtype, shape)
        channel, *known = self._channels[name]
        if known != [dtype, shape]:
            raise ValueError(f"{name}: expected {known[0]} {known[1]} at every moment, got {dtype} {shape}")
        self._writer.add_message(channel, time_ns, data, time_ns)

    def _attach(self, name: str, world: World) -> None:
        if name not in self._known:
            self._known.add(name)
            self._writer.add_attachment(0, 0, name, "model/gltf-binary", world.to_glb())


def write(path: str | PathLike[str], contents: Contents) -> None:
    """Write a recording that is complete."""
    module = require()
    with open(path, "wb") as stream:
        writer = module.Writer(stream, chunk_size=_CHUNK_BYTES)
        writer.start(profile="flockstep", library="flockstep")
        channels = ArrayChannels(writer, contents)
        written = dict.fromkeys(contents.images, 0)
        for moment, time_s in enumerate(contents.times_s):
            arrays = {name: values[moment] for name, values in contents.arrays.items()}
            images = {}
            for name, files in contents.images.items():
                end = max(int(arrays[f"camera.{name}.image"].max(initial=-1)) + 1, written[name])
                images[name], written[name] = files[written[name] : end], end
            channels.write(round(float(time_s) * 1e9), arrays, images)
        writer.finish()


class _Reader:
    def __init__(self) -> None:
        self.about: dict[str, str] | None = None
        self.topics: dict[int, tuple[str, Any]] = {}  # name and description of the array of each channel
        self.data: dict[str, list[bytes]] = {}
        self.times: dict[str, list[int]] = {}
        self.attachments: dict[str, bytes] = {}

    def take(self, record: Any) -> None:
        from mcap import records

        if isinstance(record, records.Metadata) and record.name == "flockstep":
            self.about = dict(record.metadata)
        elif isinstance(record, records.Attachment):
            self.attachments[record.name] = record.data
        elif isinstance(record, records.Channel) and record.message_encoding == _ENCODING:
            about: dict[str, Any] = dict(record.metadata)
            about["shape"] = json.loads(about.get("shape", "null"))
            self.topics[record.id] = record.topic.removeprefix(_TOPIC), about
        elif isinstance(record, records.Message) and record.channel_id in self.topics:
            name = self.topics[record.channel_id][0]
            self.data.setdefault(name, []).append(record.data)
            self.times.setdefault(name, []).append(record.log_time)


def read(path: str | PathLike[str]) -> Contents:
    """Read a recording up to its end, or to where it was cut short.

    Raises
    ------
    ValueError
        The file is not a recording, or its contents do not fit together.
    """
    require()
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    reader = _Reader()
    budget = _MOST_CHUNK_BYTES + _MOST_EXPANSION * Path(path).stat().st_size
    with open(path, "rb") as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=_MOST_CHUNK_BYTES).records:
                if not isinstance(record, Chunk):
                    reader.take(record)
                    continue
                budget -= _expanded_bytes(record)
                if budget < 0:
                    raise _TooLargeError(f"path: expected a file that expands at most {_MOST_EXPANSION}-fold")
                for part in breakup_chunk(record):
                    reader.take(part)
        except _TooLargeError:
            raise
        except Exception:  # of many kinds, by three packages: the file is cut short, or damaged from here on
            pass
    if reader.about is None or reader.about.get("format") != FORMAT:
        found = "another file" if reader.about is None else f"format {reader.about.get('format')!r}"
        raise ValueError(f"path: expected a recording of flockstep of format {FORMAT}, got {found}")
    try:
        return _contents(reader, reader.about)
    except (KeyError, TypeError, json.JSONDecodeError, UnicodeDecodeError, OverflowError, RecursionError) as error:
        raise ValueError(
            f"path: expected a recording whose parts fit together: {type(error).__name__} {error}"
        ) from error


class _TooLargeError(ValueError):
    """A file would fill the memory."""


def _expanded_bytes(chunk: Any) -> int:
    """Return the size of a chunk's content, or raise ValueError if it is unknown or too large."""
    import zstandard  # mcap needs it

    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        size = zstandard.frame_content_size(chunk.data)
        sizes += [size] if size >= 0 else []  # -1: not said, and then the chunk's own size is the limit
    elif chunk.compression:
        raise ValueError(f"chunk: expected zstd, got {chunk.compression!r}")
    if max(sizes) > _MOST_CHUNK_BYTES:
        raise _TooLargeError(f"chunk: expected at most {_MOST_CHUNK_BYTES} bytes, got {max(sizes)}")
    return int(max(sizes))


def _contents(reader: _Reader, about: Mapping[str, str]) -> Contents:
    settings = json.loads(about["settings"])
    settings["paths"] = plain_paths(settings.get("paths", ()))
    counts = {
        "E": settings["num_envs"],
        "N": settings["num_envs"] * settings["per_env"],
        "R": settings["rows"],
    }
    if not all(isinstance(count, int) and 0 <= count <= _MOST_DRONES for count in counts.values()) or counts["N"] < 1:
        raise ValueError(f"settings: expected numbers of envs and drones up to {_MOST_DRONES}, got {counts}")
    described = {
        name: about for name, about in reader.topics.values() if about["dtype"] != "jpeg" and name in reader.data
    }
    if "position" not in described:
        raise ValueError("recording: expected at least one moment with positions, got none")
    moments = min(len(reader.data[name]) for name in described)
    arrays = {name: _array(name, reader.data[name][:moments], described[name]) for name in described}
    _require_shapes(arrays, settings, counts)
    images = {}
    for camera in settings["cameras"]:
        name = str(camera["name"])
        if f"camera.{name}.image" in arrays:
            images[name] = reader.data.get(f"camera.{name}.jpeg", [])
            index = arrays[f"camera.{name}.image"]
            arrays[f"camera.{name}.image"] = np.where(index < len(images[name]), index, -1).astype(np.int32)
    attached: dict[str, dict[int, World]] = {"world": {}, "body": {}}
    for file, data in reader.attachments.items():
        kind, _, number = file.removesuffix(".glb").partition("-")
        if kind in attached and number.isdecimal():
            attached[kind][int(number)] = World.from_glb(data)
    worlds, bodies = attached["world"], attached["body"]
    if not worlds:
        raise ValueError("recording: expected a world, got none")
    if sorted(bodies) != list(range(len(bodies))):
        raise ValueError(f"bodies: expected looks with the numbers 0 to {len(bodies) - 1}, got {sorted(bodies)}"[:200])
    mesh = json.loads(about["look"])
    times = np.asarray(reader.times["position"][:moments], np.int64)
    return Contents(
        arrays=arrays,
        images=images,
        settings=settings,
        worlds=worlds,
        bodies=[bodies[number] for number in sorted(bodies)],
        drone=DroneModel.from_dict(json.loads(about["drone"])),
        look=None if mesh is None else DroneMesh.from_dict(mesh),
        recipe=about["recipe"],
        times_s=(times - times[0]) / 1e9,
        title=about["title"],
        repeats_ends=bool(json.loads(about["repeats_ends"])),
        units={name: str(described[name]["unit"]) for name in described},
    )


def _array(name: str, messages: list[bytes], about: Mapping[str, Any]) -> Array:
    dtype, shape = str(about["dtype"]), tuple(about["shape"])
    if dtype not in _DTYPES or not shape or not all(isinstance(side, int) and 0 <= side < 1 << 31 for side in shape):
        raise ValueError(f"{name}: expected an array of numbers, got {dtype} {shape}")
    size = int(np.prod(shape, dtype=object)) * np.dtype(dtype).itemsize
    wrong = next((len(message) for message in messages if len(message) != size), None)
    if wrong is not None:
        raise ValueError(f"{name}: expected messages of {size} bytes, got {wrong}")
    return np.frombuffer(b"".join(messages), dtype).reshape(len(messages), *shape)


def _listed() -> dict[str, tuple[str, list[str]]]:
    """Return dtype and shape, in words, of each array of the engine's list."""
    return {
        prefix + array["name"]: (array["dtype"], re.findall(r"\w+", array["shape"]))
        for prefix, owner in (("", Batch), ("contact.", Contact), ("bodies.", Bodies))
        for array in getattr(owner, "_arrays")  # noqa: B009 # it is not in the stub
    }


def _require_shapes(arrays: Mapping[str, Array], settings: Mapping[str, Any], counts: dict[str, int]) -> None:
    """Raise ValueError unless arrays have the types and shapes of the engine's list, and fit to the settings."""
    listed = _listed()
    listed["actions"] = "float32", ["R", "columns"]
    listed["bodies.look"] = "int32", ["E", "B"]
    listed |= dict.fromkeys(GATES, ("int32", ["N"]))
    counts = {**counts, "terms": len(settings["reward_terms"])}
    for lidar in settings["scanners"]:
        directions = np.asarray(lidar["directions"], np.float32)
        if directions.ndim != 3 or directions.shape[0] not in (1, counts["N"]) or directions.shape[2] != 3:
            raise ValueError(f"settings: expected directions of beams (1, B, 3), got {directions.shape}")
        lidar["directions"] = directions.tolist()
        listed[f"lidar.{lidar['name']}.ranges"] = "float32", ["N", str(directions.shape[1])]
        listed[f"lidar.{lidar['name']}.turn_deg"] = "float32", ["N"]
        axes = np.asarray(lidar.get("turn_axes", [[0, 0, 1]]), np.float32)
        if axes.shape not in ((1, 3), (counts["N"], 3)):
            raise ValueError(f"settings: expected axes of turned beams (1, 3), got {axes.shape}")
        lidar["turn_axes"] = axes.tolist()
    listed |= {f"camera.{camera['name']}.image": ("int32", ["N"]) for camera in settings["cameras"]}
    for name in ("position", "quat_wxyz", "active", "world_index", "episode"):
        if name not in arrays:
            raise ValueError(f"{name}: expected an array, got none")
    for name, values in arrays.items():
        dtype, shape = listed.get(name, (values.dtype.name, None))
        if shape is None:
            continue  # a later version of flockstep may have further arrays
        found = values.shape[1:]
        sides = [int(word) if word.isdigit() else counts.get(word) for word in shape]
        fits = len(sides) == len(found) and all(want in (None, got) for want, got in zip(sides, found, strict=True))
        if not fits or values.dtype.name != dtype:
            raise ValueError(f"{name}: expected {dtype} ({', '.join(shape)}), got {values.dtype} {found}")
        if "B" in shape:
            counts["B"] = found[1]  # the same for all that have it
