"""Additions to the pictures of the built-in tasks."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch
from flockstep.pictures.drawing import Drawing, Overlay
from flockstep.pictures.picture import FARTHEST_M
from flockstep.rotations import rotate

_DOWN = np.array([[0.0, 0.0, -1.0]])
_PLACE_UNIT_M = 2.0  # of the offset that the task observes
_CORNERS = {"square": 4, "ring": 32}  # of the outline of a gate's opening


class FlightOverlay:
    """Draws the target point that a drone observes, the line to it, and the drone's height.

    Parameters
    ----------
    height
        Draw a line down to the surface below the drone, with its length in metres if Pillow is installed. Seen from
        above it would only hide the drone.
    """

    markers: tuple[str, ...] = ()  # drones do not begin at the start marker, and the overlay draws the target itself

    def __init__(self, *, height: bool = True) -> None:
        self._height = height

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env, like `Task.draw`."""
        position = np.asarray(batch.position[env], float)
        way = np.asarray(batch.observation[env, :3], float)  # in the body frame
        point = position + rotate(np.asarray(batch.quat_wxyz[env], float), way)
        world = batch.world_of(env)
        _draw_target(batch, env, point, drawing)
        if not self._height:
            return
        height_m = float(world.raycast(position[None], _DOWN, FARTHEST_M)["t_hit"][0])
        if not np.isfinite(height_m):
            return
        ground = position - [0, 0, height_m]
        drawing.lines(position, ground, "grey", 1.5)
        drawing.points(ground, "grey", 6)
        _write_below(batch, position, f"{height_m:.1f} m", drawing)


class RaceOverlay:
    """Draws the next gate of a drone, the line to it, and the drone's speed if Pillow is installed."""

    markers: tuple[str, ...] = ()  # drones begin behind gates

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env, like `Task.draw`."""
        position = np.asarray(batch.position[env], float)
        gate = batch.world_of(env).gates[int(batch.task_state["target"][env])]
        center = np.asarray(gate["center"], float)
        count = _CORNERS[gate["shape"]]
        angle = 2 * np.pi * (np.arange(count + 1) + 0.5) / count
        around = np.stack([np.zeros(count + 1), np.cos(angle), np.sin(angle)], axis=1)
        outline = center + rotate(
            np.asarray(gate["quat_wxyz"], float), 0.5 * gate["size_m"] / np.abs(around[0]).max() * around
        )
        drawing.lines(outline[:-1], outline[1:], "green", 3)
        drawing.lines(position, center, "green", 1)
        drawing.points(center, "green", 6)
        _write_below(batch, position, f"{np.linalg.norm(batch.velocity[env]):.0f} m/s", drawing)


class GoalOverlay:
    """Draws the goals of drones: green that of the shown drone, grey those of the others."""

    markers: tuple[str, ...] = ()  # no drone flies from the start marker to the goal marker

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env, like `Task.draw`."""
        goals = np.asarray(batch.task_state["goal"], float)
        first = env - env % batch.drones_per_env
        drawing.points(np.delete(goals[first : first + batch.drones_per_env], env - first, axis=0), "grey", 6)
        _draw_target(batch, env, goals[env], drawing)


class PlaceOverlay:
    """Draws the place of a drone in a formation if it is within 2 m, the range of the observed offset."""

    markers: tuple[str, ...] = ()  # drones begin at their places

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env, like `Task.draw`."""
        offset = np.asarray(batch.observation[env, :3], float)  # in the body frame
        if np.linalg.norm(offset) < 0.999:  # a longer one is shortened to 1
            way = rotate(np.asarray(batch.quat_wxyz[env], float), _PLACE_UNIT_M * offset)
            _draw_target(batch, env, np.asarray(batch.position[env], float) + way, drawing)


#: The overlays that the engine's tasks name; the argument tells whether the picture is seen from above.
OVERLAYS: dict[str, Callable[[bool], Overlay]] = {
    "target": lambda from_above: FlightOverlay(height=not from_above),
    "gate": lambda _: RaceOverlay(),
    "goals": lambda _: GoalOverlay(),
    "place": lambda _: PlaceOverlay(),
}


def _draw_target(batch: Batch, env: int, point: npt.NDArray[np.float64], drawing: Drawing) -> None:
    drawing.lines(np.asarray(batch.position[env], float), point, "green", 1.5)
    drawing.points(point, "green", 8)
    drawing.spheres(point, batch.world_of(env).marker_radius_m, "green")


def _write_below(batch: Batch, position: npt.NDArray[np.float64], text: str, drawing: Drawing) -> None:
    if find_spec("PIL") is not None:
        below = 1.1 * float(np.ptp(np.asarray(batch.drone.hull, float), axis=0).max())
        drawing.text(position - [0, 0, below], text, "black", 16)
