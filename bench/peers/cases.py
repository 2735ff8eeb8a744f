"""The input of every peer, a quadrotor or rays, and its results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

DRONES = 4096
PHYSICS_HZ, POLICY_HZ = 500, 100
TICKS = PHYSICS_HZ // POLICY_HZ


@dataclass
class Quadrotor:
    """A quadrotor and its rotor speed commands, in SI units; frames and rotor order as in flockstep."""

    mass_kg: float
    inertia_kgm2: list[float]
    position_m: list[list[float]]
    spin: list[int]  # +1: counter-clockwise
    thrust_n: float  # per square of the speed
    torque_ratio_m: float
    lag_s: float
    hover_radps: float
    linear_drag: list[float]
    quadratic_drag: float
    told_radps: list[list[float]]  # (T, 4): each for 1 / POLICY_HZ


@dataclass
class Flown:
    """Results of a peer: rates per second of processor time, by mode, and final states of flights, by kind."""

    version: str = ""
    simulator: dict[str, float] = field(default_factory=dict)  # drone-substeps, with the mode's step length
    environment: dict[str, float] = field(default_factory=dict)  # drone-steps
    flights: dict[str, list[float]] = field(default_factory=dict)  # x, y, z m, w, x, y, z


SENSORS = ("camera", "LiDAR")
FAR_M = 1000.0  # maximum distance of a hit
#: Arrays of a case: one for all, and one for each sensor.
ALONE, BY_SENSOR = ("vertices", "triangles", "position", "quat_wxyz"), ("directions", "distances")
Array = npt.NDArray[Any]
Cast = Callable[[], Any]  # traces rays and returns their distances
Mode = Callable[[str], list[Cast]]  # by sensor; together the casts trace all of its rays


@dataclass
class Rays:
    """A world of triangles, sensor poses, and the rays of each sensor from all poses."""

    vertices: Array  # (V, 3) float32
    triangles: Array  # (T, 3) int32
    position: Array  # (N, 3) float32
    quat_wxyz: Array  # (N, 4) float32
    directions: dict[str, Array] = field(default_factory=dict)  # (N, R, 3) float32, unit
    distances: dict[str, Array] = field(default_factory=dict)  # (N, R) float32, ours

    def save(self, path: Path) -> None:
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ALONE}
        for sensor in SENSORS:
            arrays |= {f"{name}_{sensor}": getattr(self, name)[sensor] for name in BY_SENSOR}
        np.savez(path, **arrays)

    @staticmethod
    def load(path: Path) -> Rays:
        with np.load(path) as file:
            by_sensor = [{sensor: file[f"{name}_{sensor}"] for sensor in SENSORS} for name in BY_SENSOR]
            return Rays(*(file[name] for name in ALONE), *by_sensor)

    def by_place(self, prepare: Callable[[Array, Array], Cast]) -> Mode:
        """Return a mode that traces one position's rays per call; `prepare` gets origins and directions (R, 3)."""

        def casts(sensor: str) -> list[Cast]:
            along = self.directions[sensor]
            return [
                prepare(np.tile(place, (along.shape[1], 1)), directions)
                for place, directions in zip(self.position, along, strict=True)
            ]

        return casts
