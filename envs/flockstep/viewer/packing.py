"""A recording as the bytes that the page reads: a header in JSON, then arrays and worlds (`viewer/src/flight.ts`)."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel, DynamicsConfig, Light, World
from flockstep.drone_mesh import DroneMesh
from flockstep.quadrotor_mesh import hull_faces, rotors_of
from flockstep.recordings.moment import GATES
from flockstep.recordings.recording import Recording
from flockstep.serialization import to_plain

Array = npt.NDArray[Any]

FORMAT = 3
_KINDS = {"float64": "f8", "float32": "f4", "int32": "i4", "uint16": "u2", "uint8": "u1"}
_DOWN = np.array([0, 0, -1], np.float32)
_NO_RANGE = 65535
_ROOFED = 0.7  # share of the positions that must be below something
_FARTHEST_M = 1000.0
_MOST_RAYS = 20_000  # positions that are asked for a roof
_COLORS = {"middle": (0.10, 0.11, 0.13), "arm": (0.17, 0.18, 0.21), "rear": (0.16, 0.27, 0.55)}
_HULL = (0.25, 0.33, 0.55)
#: Curves in the order of their choice: title and name of the array.
_CURVES = (
    ("Reward terms", "reward_terms"),
    ("Actions", "actions"),
    ("Velocity", "velocity"),
    ("Height", "above_m"),
    ("Rotors", "rotor_speed"),
    ("Angular velocity", "angular_velocity"),
    ("Accelerometer", "accelerometer"),
    ("Gyroscope", "gyroscope"),
    ("Measured position", "sensed_position"),
    ("Reward", "reward"),
)
_AXES = ("x", "y", "z", "w")


@dataclass
class Had:
    """The parts of a flight that a page has, to which the packed moments are added. Default: nothing."""

    goes_on: bool = False
    worlds: int = 0
    bodies: int = 0
    images: dict[str, int] = field(default_factory=dict)
    """Number of images by camera."""


class _Packer:
    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self._places: dict[bytes, list[int]] = {}
        self.arrays: list[dict[str, Any]] = []

    def place(self, data: bytes) -> list[int]:
        """Return where some bytes are: begin and length. The same bytes are kept once."""
        if data not in self._places:
            self._places[data] = [self._size, len(data)]
            padded = data + bytes(-len(data) % 8)
            self._parts.append(padded)
            self._size += len(padded)
        return self._places[data]

    def add(self, name: str, values: Array, scale: float = 1.0, offset: float = 0.0, none: int | None = None) -> None:
        kind = _KINDS[values.dtype.name]
        at = self.place(np.ascontiguousarray(values).tobytes())[0]
        shown = {"scale": scale, "offset": offset, "none": none}
        self.arrays.append({"name": name, "dtype": kind, "shape": list(values.shape), "at": at, **shown})

    def packed(self, header: dict[str, Any]) -> bytes:
        text = json.dumps({**header, "arrays": self.arrays}, allow_nan=False).encode()
        begin = len(text).to_bytes(4, "little") + text
        return begin + bytes(-len(begin) % 8) + b"".join(self._parts)


def pack(recording: Recording, had: Had | None = None) -> bytes:
    """Return the bytes of a recording, without what a page has of it."""
    packer, settings, had = _Packer(), recording._contents.settings, had or Had()
    drones = recording.num_envs * recording.drones_per_env
    position = recording["position"].astype(np.float32)
    worlds = {index: number for number, index in enumerate(recording.worlds)}
    index = np.vectorize(lambda key: worlds.get(int(key), 0), otypes=[np.uint16])(recording["world_index"])
    height = _heights(recording, position, index)
    packer.add("time_s", np.asarray(recording.times_s, np.float64))
    packer.add("position", position)
    packer.add("quat_wxyz", recording["quat_wxyz"].astype(np.float32))
    packer.add("active", recording["active"].astype(np.uint8))
    packer.add("world_index", index)
    packer.add("episode", recording.drone_episodes.astype(np.int32))
    packer.add("above_m", height)
    for name in ("velocity", "rotor_speed", "bodies.position", "bodies.quat_wxyz", "contact.point"):
        if name in recording:
            packer.add(name, recording[name].astype(np.float32))
    for name, kind in {"contact.hit": np.uint8, **dict.fromkeys(("bodies.look", *GATES), np.int32)}.items():
        if name in recording:
            packer.add(name, recording[name].astype(kind))
    curves = []
    for title, name in _CURVES:
        if name not in recording and name != "above_m":
            continue
        if name not in [array["name"] for array in packer.arrays]:
            packer.add(name, recording[name].astype(np.float32))
        values = height if name == "above_m" else recording[name]
        unit = "m" if name == "above_m" else recording._contents.units.get(name, "")
        columns = _columns(name, values, recording)
        curves.append({"title": title, "unit": "" if unit == "1" else unit, "array": name, "columns": columns})
    header = {
        "format": FORMAT,
        "goes_on": had.goes_on,
        "title": recording.title,
        "steps": len(recording),
        "envs": recording.num_envs,
        "per_env": recording.drones_per_env,
        "rows": int(settings["rows"]) or drones,
        "first_world": had.worlds,
        "worlds": [
            _world(packer, world, _cut(world, position, index == i))
            for i, world in enumerate(recording.worlds.values())
            if i >= had.worlds
        ],
        "first_body": had.bodies,
        "bodies": [
            {"name": look.name, "glb": packer.place(look.to_glb())} for look in recording._contents.bodies[had.bodies :]
        ],
        "drone": None if had.goes_on else _drone(packer, recording.drone, recording.drone_mesh),
        "scanners": [_lidar(packer, lidar, recording, had) for lidar in settings["scanners"]],
        "cameras": [
            _camera(packer, camera, recording, had)
            for camera in settings["cameras"]
            if camera["name"] in recording.images
        ],
        "curves": curves,
        "ends": [
            {
                "step": end.moment,
                "row": end.row,
                "reason": end.reason.name,
                "success": end.success,
                "reward": end.episode_return if math.isfinite(end.episode_return) else 0.0,
                "steps": end.episode_length,
            }
            for end in recording.ends
        ],
        "paths": settings["paths"],
    }
    return packer.packed(header)


def header(packed: bytes) -> dict[str, Any]:
    """Return what `pack` says of a recording beside its numbers."""
    found: dict[str, Any] = json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "little")])
    return found


def _columns(name: str, values: Array, recording: Recording) -> list[str]:
    width = int(np.prod(values.shape[2:], dtype=int))
    if name == "reward_terms":
        return recording.reward_terms
    if width == 1:
        return [name.removesuffix("_m").replace("_", " ")]
    if width <= 3 and name not in ("actions", "rotor_speed"):
        return list(_AXES[:width])
    return [str(i) for i in range(width)]


def _heights(recording: Recording, position: Array, index: Array) -> Array:
    """Return the heights (T, N) above what is below each drone in its world, m; NaN above nothing."""
    heights = np.full(position.shape[:2], np.nan, np.float32)
    of_drones = np.repeat(index, recording.drones_per_env, axis=1)
    for number, world in enumerate(recording.worlds.values()):
        here = (of_drones == number) & np.isfinite(position).all(axis=2)
        places = position[here]
        if len(places):
            hit = world.raycast(places, np.broadcast_to(_DOWN, places.shape), _FARTHEST_M)["t_hit"]
            heights[here] = np.where(np.isfinite(hit), hit, np.nan)
    return heights


def _cut(world: World, position: Array, is_here: Array) -> float | None:
    """Return the height above which a world is cut open, so that one sees its drones: None without a roof."""
    places = position.reshape(len(position), is_here.shape[1], -1, 3)[is_here].reshape(-1, 3)
    places = places[np.isfinite(places).all(axis=1)]
    places = places[:: max(len(places) // _MOST_RAYS, 1)]
    if not len(places):
        return None
    above = world.raycast(places, np.broadcast_to(-_DOWN, places.shape), _FARTHEST_M)["t_hit"]
    roofs = (places[:, 2] + above)[np.isfinite(above)]
    if len(roofs) < _ROOFED * len(places):
        return None
    roof, highest = float(np.median(roofs)), float(places[:, 2].max())
    return max(min(roof - 0.05, highest + 0.6), highest + 0.05)


def _world(packer: _Packer, world: World, cut_m: float | None) -> dict[str, Any]:
    return {
        "name": world.name,
        "glb": packer.place(world.with_bodies(None).to_glb()),
        "cut_m": cut_m,
        "start": _place(world.start),
        "through": [_place(place) for place in world.waypoints],
        "goal": _place(world.goal),
        "marker_m": float(world.marker_radius_m),
        "race_gates": to_plain(world.gates),
        "bounds": np.asarray(world.bounds, float).tolist(),
        "sun": [float(part) for part in Light(**world.light).sun_direction],
    }


def _place(place: npt.ArrayLike | None) -> list[float] | None:
    return None if place is None else [float(part) for part in np.asarray(place)]


def _drone(packer: _Packer, drone: DroneModel, mesh: DroneMesh | None) -> dict[str, Any]:
    is_quadrotor = mesh is None and drone.to_dict().get("rotors") is not None
    vertices = np.asarray(drone.hull, float)
    hull = DroneMesh(vertices, hull_faces(vertices), _HULL)
    if is_quadrotor:
        mesh = DroneMesh._quadrotor(drone, _COLORS, propellers=False)
    hubs, spins, radius = rotors_of(drone) if is_quadrotor else (np.zeros((0, 3)), [], 0.0)
    limits = DynamicsConfig()
    return {
        "name": drone.name,
        "glb": packer.place((mesh or hull).world().to_glb()),
        "hull": packer.place(hull.world().to_glb()),
        "hubs": hubs.tolist(),
        "spins": [1 if spin == "ccw" else -1 for spin in spins],
        "rotor_m": radius,
        "model": drone.to_dict(),  # by which the page itself can fly it
        "most_dps": [limits.max_rate_dps, limits.max_rate_dps, limits.max_yaw_rate_dps],
    }


def _lidar(packer: _Packer, lidar: dict[str, Any], recording: Recording, had: Had) -> dict[str, Any]:
    name, most = f"lidar.{lidar['name']}", float(lidar["reach_m"])
    ranges = recording[f"{name}.ranges"].astype(float)
    scale = max(most, float(np.max(ranges, initial=0.0, where=np.isfinite(ranges)))) / (_NO_RANGE - 1)
    numbers = np.where(np.isfinite(ranges), np.round(np.nan_to_num(ranges, posinf=0.0) / scale), _NO_RANGE)
    packer.add(f"{name}.ranges", numbers.astype(np.uint16), scale=scale, none=_NO_RANGE)
    if not had.goes_on:
        packer.add(f"{name}.directions", np.asarray(lidar["directions"], np.float32))
    kept = {"name": lidar["name"], "offset_m": lidar["offset_m"], "reach_m": most}
    if f"{name}.turn_deg" in recording:
        packer.add(f"{name}.turn_deg", recording[f"{name}.turn_deg"])
        kept |= {"turn": f"{name}.turn_deg", "turn_axes": lidar["turn_axes"]}
    return {**kept, "ranges": f"{name}.ranges", "directions": f"{name}.directions"}


def _camera(packer: _Packer, camera: dict[str, Any], recording: Recording, had: Had) -> dict[str, Any]:
    name, files = f"camera.{camera['name']}", recording.images[camera["name"]]
    packer.add(f"{name}.image", recording[f"{name}.image"].astype(np.int32))
    at = packer.place(b"".join(files))[0]
    ends = np.cumsum([at, *map(len, files)]).tolist()
    return {**camera, "frames": f"{name}.image", "first": had.images.get(camera["name"], 0), "data": ends}
