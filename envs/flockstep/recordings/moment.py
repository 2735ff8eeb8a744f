"""Reads a batch for a recording, by the names of the engine's list of arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, BodyConfig, Camera, Lidar, World, batch_keywords
from flockstep.rotations import rotate

Array: TypeAlias = npt.NDArray[Any]

#: Never part of a recording: settings, counters of the whole program, and what other arrays contain.
_LEFT_OUT = ("params", "max_range_m", "move_line_visible", "beams_visible", "bad_states", "episode_terms", "flying")
_COLORS = ("rgb", "grey")  # of which JPEG files are kept
_JPEG_QUALITY = 85
#: By the names of arrays (N,) int32 of a recording, those of a task, as Race has them: the index of each drone's next
#: gate, and the number that it has passed in its episode.
GATES = {"gate.next": "target", "gate.passed": "passed"}


class Described(NamedTuple):
    """One array of a recording."""

    unit: str
    read: Callable[[], Array]


class Moments:
    """Reads a batch step by step.

    Parameters
    ----------
    batch
        The batch.
    envs
        Number of envs that are read. None: all.
    first
        The first of them.
    pixels
        Also read what cameras write beside colours, such as depth. It may fill the memory of what keeps many moments.
    """

    def __init__(self, batch: Batch, envs: int | None = None, first: int = 0, *, pixels: bool = False) -> None:
        self.batch, self.first = batch, first
        self.envs = batch.num_envs - first if envs is None else min(envs, batch.num_envs - first)
        self.drones = self.envs * batch.drones_per_env
        self.rows = self._rows()
        counts = {"N": self.drones, "E": self.envs, "R": self.rows}
        #: By the letter of the engine's list of arrays, the rows that are read.
        self.slices = {name: slice(first * n // self.envs, first * n // self.envs + n) for name, n in counts.items()}
        self.arrays = self._readers() | self._sensors(pixels)
        #: Worlds by their `world_index`, and looks of moving objects by number, as far as they have been seen.
        self.worlds: dict[int, World] = {}
        self.bodies: list[World] = []
        self._looks: dict[tuple[Any, ...], int] = {}
        self._cameras = [camera.name for camera in batch.cameras if {*_COLORS} & {*camera.outputs}]
        self._frames = {name: np.full((2, self.drones), -1, np.int64) for name in self._cameras}
        self._image = {name: np.full(self.drones, -1, np.int32) for name in self._cameras}
        self._images = dict.fromkeys(self._cameras, 0)

    def _rows(self) -> int:
        try:
            return self.envs if self.batch.spec.row == "env" else self.drones
        except (AttributeError, RuntimeError):  # a batch without a task
            return 0

    def _readers(self) -> dict[str, Described]:
        batch, found = self.batch, dict[str, Described]()
        for prefix, owner in (("", batch), ("contact.", batch.contact), ("bodies.", batch.bodies)):
            for array in getattr(owner, "_arrays"):  # noqa: B009 # the list of arrays is not in the stub
                name = array["name"]
                if name in _LEFT_OUT or (prefix == "bodies." and len(batch.bodies) == 0):
                    continue
                try:
                    size = getattr(owner, name).size
                except (AttributeError, RuntimeError):  # kinematic motion has no velocities, a mere batch no rewards
                    continue
                if size:
                    read = _reader(owner, name, self.slices[array["shape"][1]])
                    found[prefix + name] = Described(array["unit"], read)
        return found

    def _sensors(self, pixels: bool) -> dict[str, Described]:
        """Return the arrays of sensors that are not attributes of the batch, as ``KIND.NAME.ARRAY``."""
        batch, found = self.batch, dict[str, Described]()
        attributes = _units_of(Batch)
        units = _units_of(Lidar) | _units_of(Camera) | attributes
        for kind, field in batch_keywords.items():
            if kind == field or (kind == "camera" and not pixels):  # no list of sensors, or not asked for
                continue
            for number, config in enumerate(getattr(batch, field)):
                sensor = f"{kind}.{config.name}"
                for name, values in batch.sensor(sensor).items():
                    is_attribute = number == 0 and name in attributes
                    if values.size and not is_attribute and name not in (*_LEFT_OUT, *_COLORS):
                        read = _sensor_reader(batch, sensor, name, self.slices["N"])
                        found[f"{sensor}.{name}"] = Described(units[name], read)
        return found

    def settings(self) -> dict[str, Any]:
        """Return the sensors' settings and the names of reward terms, as JSON values."""
        batch = self.batch
        lidars, cameras = [], []
        for lidar in batch.lidars:
            kept = {"name": lidar.name, "reach_m": lidar.max_range_m, "offset_m": list(lidar.offset_m)}
            lidars.append({**kept, **self._beams(batch.lidar(lidar.name))})
        for camera in batch.cameras:
            tangents = [camera.width_px / 2 / camera.fx, camera.height_px / 2 / camera.fy]  # of half the fields of view
            kept = {"offset_m": list(camera.offset_m), "quat_wxyz": list(camera.quat_wxyz), "tangents": tangents}
            cameras.append({"name": camera.name, **kept})
        terms = list(batch.spec.reward_terms) if self.rows else []
        counts = {"num_envs": self.envs, "per_env": batch.drones_per_env, "rows": self.rows}
        return {**counts, "scanners": lidars, "cameras": cameras, "reward_terms": terms}

    def _beams(self, lidar: Lidar) -> dict[str, Any]:
        """Return the directions (N, B, 3) of a LiDAR's beams, and the axes (N, 3) if they turn about them; not turned.

        What all drones have in common is listed once.
        """
        rows = self.slices["N"]
        beams = {"directions": lidar.directions[rows].reshape(self.drones, -1, 3)}
        if lidar.config.turn_deg:
            mountings = np.array([lidar.config_of(rows.start + i).quat_wxyz for i in range(self.drones)], np.float32)
            axes = rotate(mountings / np.linalg.norm(mountings, axis=1, keepdims=True), np.array([0, 0, 1], np.float32))
            half = np.radians(lidar.turn_deg[rows, None]) / 2
            turn = np.hstack([np.cos(half), np.sin(half) * axes])
            beams = {"directions": rotate(turn[:, None], beams["directions"], inverse=True), "turn_axes": axes}
        shared = {name: np.allclose(values, values[0], rtol=0, atol=2e-6) for name, values in beams.items()}
        return {name: values[: 1 if shared[name] else None].tolist() for name, values in beams.items()}

    def _episodes(self) -> Array:
        """Return the number of each drone's episode, in which the steps of its images count from 0."""
        episodes = np.repeat(self.batch.episode[self.slices["E"]], self.batch.drones_per_env)
        own = self.batch.own_episodes
        return episodes + own[self.slices["N"]] if len(own) else episodes

    def now(self) -> tuple[dict[str, Array], dict[str, list[bytes]]]:
        """Return the arrays, and by camera the new images as JPEG files, to which ``camera.NAME.image`` counts.

        ``bodies.look`` (E, B) int32 counts to the looks of moving objects; -1 is invisible.
        """
        for env in range(self.first, self.first + self.envs):
            if (index := int(self.batch.world_index[env])) not in self.worlds:
                self.worlds[index] = self.batch.world_of(env * self.batch.drones_per_env)
        arrays = {name: array.read() for name, array in self.arrays.items()}
        if "bodies.active" in arrays:
            looks = arrays["bodies.look"] = np.full(arrays["bodies.active"].shape, -1, np.int32)
            for env, body in np.argwhere(arrays["bodies.active"]).tolist():
                looks[env, body] = self._look(self.first + env, body)
        images: dict[str, list[bytes]] = {}
        for name in self._cameras:
            camera = self.batch.camera(name)
            frame = np.array(camera.frame_step[self.slices["N"]])
            frames = np.stack([frame, self._episodes()])
            new = np.flatnonzero((frames != self._frames[name]).any(axis=0) & (frame >= 0))
            images[name] = [camera.jpeg(self.slices["N"].start + int(drone), _JPEG_QUALITY) for drone in new]
            self._image[name][new] = self._images[name] + np.arange(len(new))
            self._image[name][frame < 0] = -1
            self._images[name] += len(new)
            self._frames[name] = frames
            arrays[f"camera.{name}.image"] = self._image[name].copy()
        return arrays, images

    def _look(self, env: int, body: int) -> int:
        """Return the number of the look of a moving object. A slot may hold another object at each moment."""
        config = self.batch.bodies.config(env, body)
        if config is None or config.visibility == "solid":
            return -1
        mesh = config.mesh  # kept by its look, so that no other one gets its id
        key = (config.name, config.shape, *config.size_m, *config.color, id(mesh))
        if key not in self._looks:
            self._looks[key] = len(self.bodies)
            self.bodies.append(look_of(config) if mesh is None else mesh)
        return self._looks[key]


def _units_of(owner: Any) -> dict[str, str]:
    return {array["name"]: array["unit"] for array in owner._arrays}


def _reader(owner: Any, name: str, rows: slice) -> Callable[[], Array]:
    return lambda: np.array(getattr(owner, name)[rows])


def _sensor_reader(batch: Batch, sensor: str, name: str, drones: slice) -> Callable[[], Array]:
    def read() -> Array:
        values = np.array(batch.sensor(sensor)[name][drones])
        is_scan = sensor.startswith("lidar.") and values.ndim > 1
        return values.reshape(len(values), -1) if is_scan else values

    return read


def look_of(body: BodyConfig) -> World:
    """Return the look of a moving object without a mesh around its own origin."""
    x, y, z = (float(size) for size in body.size_m)
    round_size: dict[str, Any] = {"radius": x / 2} if body.shape == "sphere" else {"radius": x / 2, "height": z}
    kind = {"box": "boxes", "sphere": "spheres", "cylinder": "cylinders", "capsule": "capsules"}[body.shape]
    size = {"size": [x, y, z]} if body.shape == "box" else round_size
    scene = {
        "flockstep_scene": 1,
        "name": body.name,
        "materials": {"body": {"base_color": [float(part) for part in body.color]}},
        kind: [{"center": [0, 0, 0], **size, "material": "body"}],
    }
    return World.from_dict(scene)
