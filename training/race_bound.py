"""Lap times of a point mass, to compare with those of policies: the same gates and thrust, no rotation, no drag.

.venv/bin/python -m training.race_bound                  # the bundled tracks
.venv/bin/python -m training.race_bound race/split-s --thrust-to-weight 6

The point mass passes every gate anywhere in its opening. Between two gates its thrust is constant in `parts` intervals
of equal duration, in any direction and up to the given multiple of its weight; it may change abruptly. The lap ends
with the position and velocity of its start. SLSQP of SciPy finds a local optimum from several first guesses, of which
the fastest is printed. It is a yardstick, not a proven bound: more intervals or other guesses may find a faster lap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import tyro
from scipy.optimize import minimize

import flockstep
from flockstep.rotations import rotate
from flockstep.trainings.varied import RACED

Array = npt.NDArray[Any]

GRAVITY = np.array([0.0, 0.0, -9.81])
SPEEDS_MPS = (7.0, 9.0, 11.0)  # of the first guesses
TOLERANCE = 1e-5


@dataclass
class Args:
    """Options."""

    worlds: tyro.conf.Positional[tuple[str, ...]] = ("race/figure-8", "race/split-s", "race/warehouse")
    """Names or paths of worlds with gates."""
    thrust_to_weight: float = RACED.max_thrust_to_weight
    """Largest thrust over the weight."""
    parts: int = 8
    """Intervals of constant thrust from one gate to the next."""


class Lap:
    """The optimisation of a lap; its variables are one vector.

    For each gate the vector has the point of the opening (2) and the velocity (3) there, the duration of the way to the
    next gate (1), and the thrusts over the largest thrust on this way (parts, 3). Lengths are in m, times in s.
    """

    def __init__(self, gates: list[dict[str, Any]], most: float, parts: int) -> None:
        self.parts, self.most, self.count = parts, most, len(gates)
        self.width = 6 + 3 * parts
        self.centers = np.array([gate["center"] for gate in gates], float)
        quats = np.array([gate["quat_wxyz"] for gate in gates], float)
        self.normals, self.across, self.up = (rotate(quats, axis) for axis in np.eye(3))
        self.half = 0.5 * np.array([gate["size_m"] for gate in gates])
        self.is_ring = np.array([gate["shape"] == "ring" for gate in gates])
        self.lever = parts - 0.5 - np.arange(parts)  # of a constant acceleration in the position at the end

    def first_guess(self, speed_mps: float) -> Array:
        """Return a lap through the centres at a constant speed, with the thrusts of hovering."""
        x = np.zeros((self.count, self.width))
        way = np.roll(self.centers, -1, axis=0) - self.centers
        x[:, 2:5] = speed_mps * self.normals
        x[:, 5] = np.linalg.norm(way, axis=1) / speed_mps
        x[:, 8::3] = -GRAVITY[2] / self.most
        return x.ravel()

    def gaps(self, flat: Array) -> Array:
        """Return the differences between the end of each way and the state at the next gate; a lap has zeros."""
        x = flat.reshape(self.count, self.width)
        thrust = x[:, 6:].reshape(self.count, self.parts, 3)
        t, h = x[:, 5:6], x[:, 5:6] / self.parts
        acceleration = self.most * thrust + GRAVITY
        end_v = x[:, 2:5] + h * acceleration.sum(axis=1)
        place = self.centers + x[:, 0:1] * self.across + x[:, 1:2] * self.up
        end_p = place + t * x[:, 2:5] + h**2 * np.einsum("gpk,p->gk", acceleration, self.lever)
        return np.concatenate([end_p - np.roll(place, -1, axis=0), end_v - np.roll(x[:, 2:5], -1, axis=0)], 1).ravel()

    def gaps_slope(self, flat: Array) -> Array:
        """Return the derivatives of `gaps`."""
        x = flat.reshape(self.count, self.width)
        slope = np.zeros((self.count, 6, self.count, self.width))
        acceleration = self.most * x[:, 6:].reshape(self.count, self.parts, 3) + GRAVITY
        for i in range(self.count):
            j, t, h = (i + 1) % self.count, x[i, 5], x[i, 5] / self.parts
            slope[i, :3, i, 0], slope[i, :3, i, 1] = self.across[i], self.up[i]
            slope[i, :3, j, 0], slope[i, :3, j, 1] = -self.across[j], -self.up[j]
            slope[i, :3, i, 2:5] = t * np.eye(3)
            slope[i, 3:, i, 2:5], slope[i, 3:, j, 2:5] = np.eye(3), -np.eye(3)
            slope[i, :3, i, 5] = x[i, 2:5] + 2 * h / self.parts * self.lever @ acceleration[i]
            slope[i, 3:, i, 5] = acceleration[i].sum(axis=0) / self.parts
            for part in range(self.parts):
                where = slice(6 + 3 * part, 9 + 3 * part)
                slope[i, :3, i, where] = h**2 * self.lever[part] * self.most * np.eye(3)
                slope[i, 3:, i, where] = h * self.most * np.eye(3)
        return slope.reshape(6 * self.count, -1)

    def room(self, flat: Array) -> Array:
        """Return what a lap has not below zero.

        These are 1 minus the squared thrusts, the velocities through the gates, and 1 minus the squared offsets in
        rings.
        """
        x = flat.reshape(self.count, self.width)
        thrust = x[:, 6:].reshape(-1, 3)
        rings = x[self.is_ring]
        offset = (rings[:, :2] ** 2).sum(axis=1) / self.half[self.is_ring] ** 2
        return np.concatenate([1 - (thrust**2).sum(axis=1), (self.normals * x[:, 2:5]).sum(axis=1), 1 - offset])

    def room_slope(self, flat: Array) -> Array:
        """Return the derivatives of `room`."""
        x = flat.reshape(self.count, self.width)
        slope = np.zeros((self.count * self.parts, self.count, self.width))
        for row in range(self.count * self.parts):
            i, part = divmod(row, self.parts)
            where = slice(6 + 3 * part, 9 + 3 * part)
            slope[row, i, where] = -2 * x[i, where]
        forward = np.zeros((self.count, self.count, self.width))
        for i in range(self.count):
            forward[i, i, 2:5] = self.normals[i]
        rings = np.flatnonzero(self.is_ring)
        offset = np.zeros((len(rings), self.count, self.width))
        for row, i in enumerate(rings):
            offset[row, i, :2] = -2 * x[i, :2] / self.half[i] ** 2
        every = np.concatenate([slope, forward, offset])
        return every.reshape(len(every), -1)

    def bounds(self) -> list[tuple[float | None, float | None]]:
        """Return the limits of each variable: openings, and durations above zero."""
        limits: list[tuple[float | None, float | None]] = []
        for half in self.half:
            limits += [(-half, half)] * 2 + [(None, None)] * 3 + [(0.05, None)] + [(-1.0, 1.0)] * (3 * self.parts)
        return limits

    def best_s(self, flat: Array) -> float:
        """Return the duration of the best lap that is found from a first guess; infinite if none is."""
        durations = np.zeros((self.count, self.width))
        durations[:, 5] = 1
        found = minimize(
            lambda x: float(durations.ravel() @ x),
            flat,
            jac=lambda x: durations.ravel(),
            bounds=self.bounds(),
            constraints=[
                {"type": "eq", "fun": self.gaps, "jac": self.gaps_slope},
                {"type": "ineq", "fun": self.room, "jac": self.room_slope},
            ],
            method="SLSQP",
            options={"maxiter": 300, "ftol": 1e-6},
        )
        is_lap = np.abs(self.gaps(found.x)).max() < TOLERANCE and self.room(found.x).min() > -TOLERANCE
        return float(found.fun) if is_lap else np.inf


def lap_s(world: flockstep.World, thrust_to_weight: float, parts: int) -> float:
    """Return the fastest lap that is found from several first guesses; infinite if none is."""
    lap = Lap(list(world.gates), -thrust_to_weight * GRAVITY[2], parts)
    return min(lap.best_s(lap.first_guess(speed)) for speed in SPEEDS_MPS)


def main(args: Args) -> None:
    """Print the lap of each world."""
    for name in args.worlds:
        seconds = lap_s(flockstep.World.load(name), args.thrust_to_weight, args.parts)
        print(f"{name}: {seconds:.2f} s a lap at {args.thrust_to_weight:g} times the weight")


if __name__ == "__main__":
    main(tyro.cli(Args))
