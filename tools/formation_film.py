"""The film of a formation that flies through a warehouse, seen from behind it and from above.

The warehouse is smaller than those of training and evaluation, and has a waypoint at each turn of its path. The film is
six times as fast as the flight.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.picture import FARTHEST_M
from flockstep.pictures.stage import Stage
from flockstep.rotations import rotate
from flockstep.trainings.table import FORMATION, FORMATION_STEPS
from tools.film import FINER, INK, Color, Frame, Shot, steps_of, write_captions

Array = npt.NDArray[Any]

STEP_MS = 100
EVERY = 6  # steps from picture to picture
HOLD_MS = 1500  # the last picture
BEHIND_M, ABOVE_M = 4.5, 0.6  # of the viewer, from the middle of the formation
CLEAR_M = 0.4  # of the viewer, below obstacles
TRAIL_M = 6.0  # seen from behind
MAP_FROM_M = 100.0  # height of the viewer of the map
CUT_M = 0.7  # of the map, above the highest drone


@dataclass
class Flight:
    """The poses of M drones after each of T steps, and their places."""

    world: flockstep.World
    drone: flockstep.DroneModel
    position: Array
    """(T, M, 3) m."""
    quat_wxyz: Array
    """(T, M, 4)."""
    place: Array
    """(T, M, 3) m."""


def fly(model: Any, seed: int) -> Flight:
    """Fly one episode."""
    world = flockstep.World.warehouse(seed, size_m=(36.0, 24.0), waypoints=True)
    envs = flockstep.DroneVectorEnv(
        1,
        **FORMATION,
        worlds=world,
        max_episode_steps=FORMATION_STEPS["warehouse"],
        autoreset_mode="disabled",
    )
    states: list[tuple[Array, Array, Array]] = []
    for observation, _ in steps_of(envs, model, seed):
        position, quat = envs.batch.position.astype(float), envs.batch.quat_wxyz.astype(float)
        states.append((position, quat, position + rotate(quat, 2 * observation[:, :3].astype(float))))
    positions, quats, places = (np.array(each) for each in zip(*states, strict=True))
    error = float(np.linalg.norm(places - positions, axis=2).mean())
    print(f"{'flown to the end' if envs.batch.success.all() else 'not flown to the end'}, error {error:.3f} m")
    drone = envs.batch.drone
    envs.close()
    return Flight(world, drone, positions, quats, places)


class Behind:
    """Draws the drones and their trails from behind and above the formation."""

    def __init__(self, flight: Flight, inks: list[Color], size_px: tuple[int, int]) -> None:
        self.flight, self.inks, self.world = flight, inks, flight.world
        self.stage = Stage(flight.world, 1.0, size_px, FINER**2, markers=())
        self.body = Body(flight.drone)
        middle = flight.position.mean(axis=1)
        self.way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
        first = middle[min(10, len(middle) - 1)] - middle[0]
        ago = -(BEHIND_M + 2)
        self.ways = np.insert(self.way, 0, ago)
        self.middle = np.insert(middle, 0, middle[0] + ago * first / np.linalg.norm(first), axis=0)

    def along(self, way: float, metres: float) -> Array:
        """Return points of the middle's way, up to some metres before and after this one, (K, 3) m."""
        around = way + metres * np.linspace(-1, 1, 21)
        points = np.stack([np.interp(around, self.ways, self.middle[:, axis]) for axis in range(3)], axis=1)
        low, high = self.world.bounds
        return np.clip(points, low + 0.5, high - 0.5)

    def viewer(self, way: float) -> Array:
        """Return the position of the viewer, (3,) m: above the way, but below obstacles; both change smoothly."""
        points = self.along(way, 2.0)
        room = self.world.raycast(points, [[0.0, 0.0, 1.0]] * len(points), ABOVE_M + CLEAR_M)["t_hit"]
        above = np.clip(room - CLEAR_M, 0, ABOVE_M)
        least = [above[i : i + 11].min() for i in range(11)]  # within 1 m
        position: Array = self.along(way, 1.0).mean(axis=0)
        position[2] += np.mean(least)
        return position

    def frame(self, step: int) -> Image.Image:
        """Draw one picture."""
        flight = self.flight
        viewer = self.viewer(self.way[step] - BEHIND_M)
        target = self.along(self.way[step] + 1.0, 1.0).mean(axis=0)
        drones = [self.body.at(*pose) for pose in zip(flight.position[step], flight.quat_wxyz[step], strict=True)]
        canvas = self.stage.seen_from(viewer, target, drones)
        recent = self.way[: step + 1] > self.way[step] - TRAIL_M
        for m, ink in enumerate(self.inks):
            trail = flight.position[: step + 1, m][recent]
            canvas.lines(trail[:-1], trail[1:], ink, width_px=2 * FINER)
            canvas.sphere(flight.position[step, m] + [0, 0, 0.1], 0.12, ink)
        return Image.fromarray(canvas.rgb)


def frames(shot: Shot) -> Iterator[Frame]:
    """Fly, and draw both views side by side, one picture for every few steps."""
    flight = fly(shot.model, shot.seed)
    count = flight.position.shape[1]
    hues = [colorsys.hsv_to_rgb(m / count, 0.8, 0.9) for m in range(count)]
    inks: list[Color] = [(int(255 * r), int(255 * g), int(255 * b)) for r, g, b in hues]
    width = FINER * shot.width_px
    height = width * 5 // 8
    low, high = flight.world.bounds[:, :2].astype(float)
    middle, half = (low + high) / 2, (high - low) / 2
    scale = height / 2 / half[1]
    map_width = round(2 * half[0] * scale)
    camera = flockstep.CameraConfig(
        width_px=map_width,
        height_px=height,
        hfov_deg=2 * float(np.degrees(np.arctan(half[0] / MAP_FROM_M))),
        near_m=MAP_FROM_M - float(flight.position[..., 2].max()) - CUT_M,
        far_m=FARTHEST_M,
        shadows=True,
    )
    down = np.array([0.5, -0.5, 0.5, 0.5])
    ground = Image.fromarray(flockstep.render(flight.world, [*middle, MAP_FROM_M], down, camera=camera)["rgb"])
    behind = Behind(flight, inks, (width // FINER, height // FINER))
    radius = float(np.linalg.norm(flight.drone.hull[:, :2], axis=1).max())

    def pixels(points: Array) -> list[tuple[float, float]]:
        return [tuple(p) for p in (points[..., :2] - middle + half * [1, -1]) * scale * [1, -1]]

    last = shot.steps(STEP_MS, len(flight.position) - 1)
    for step in [*range(0, last, EVERY), last]:
        above = ground.copy()
        draw = ImageDraw.Draw(above)
        for m, ink in enumerate(inks):
            draw.line(pixels(flight.position[: step + 1, m]), fill=ink, width=FINER + 1)
        for m, ink in enumerate(inks):
            draw.circle(pixels(flight.place[step, m][None])[0], 1.8 * radius * scale, outline=ink, width=FINER)
            draw.circle(pixels(flight.position[step, m][None])[0], radius * scale, fill=ink)
        seen, above = behind.frame(step), above.reduce(FINER)
        picture = Image.new("RGB", (seen.width + above.width, seen.height))
        picture.paste(seen, (0, 0))
        picture.paste(above, (seen.width, 0))
        write_captions(picture, [(6, 15, f"{step * STEP_MS / 1000:.0f} s", INK)])
        yield picture, HOLD_MS if step == last else STEP_MS
