"""The film of a flight of the LiDAR task: from the start via the waypoints to the goal of a playground.

The policy is the bundled `lidar`. The playground is a generated one in which it was not trained, with 24 pillars
instead of 12. The policy reaches the goal in 284 of the first 300 such playgrounds. This one was chosen for the film:
the path leads past many pillars and does not cross itself.

The film plays at 2.5 times the speed of the flight. A step moves the drone by 0.1 m along one axis, so the path is
smoothed. The program checks that the drone can fly the smoothed path too, and prints its largest distance to the flown
one. The LiDAR scans at each pose of the film; beams without a hit fade out. The pillars' positions and radii are those
of the playground; colours and light are the film's. The ceiling is left out, two walls are low, and the pillars end
above the flight. The drone, the beams and the path shine through pillars.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

import flockstep
from flockstep.pictures.depth_canvas import DepthCanvas, blended
from flockstep.pictures.lines import beams_of, draw_beams
from flockstep.pictures.picture import facing, render
from flockstep.pictures.style import STYLES
from flockstep.relight import DARK_LIGHT
from tools.film import FINER, Frame, Shot, add_floor, smooth
from training.evaluate import MAX_STEPS, fly, greedy

Array = npt.NDArray[Any]
Linear = tuple[float, float, float]

PILLARS = 24
FPS = 15
SPEED = 2.5  # of the film, as a multiple of the flight's
HOLD_MS = 1500  # the last picture
SMOOTH_STEPS = 3.0  # standard deviation of the path's smoothing
GOAL_RADIUS_M = 0.5  # of the task

TARGET_M = np.array([0.5, 0.3, 1.2])  # target of the view, relative to the ground below the middle of the path
AWAY_M = np.array([-1.0, -10.5, 11.5])  # viewer, relative to the target
HFOV_DEG = 46.0
CUT_M, LOW_M, WALL_M = 3.0, 0.3, 0.12  # height of pillars and far walls, height of near walls, thickness
ROTOR_Z_M = 0.06  # rotor discs, above the hubs
GHOST = 0.5  # opacity of the drone behind a pillar
THROUGH = 0.25  # opacity of beams and the trail behind a pillar, as a share of the others'
TRAIL, TRAIL_OPACITY = (30, 12), 0.5  # numbers of the last pictures whose trail is drawn again, over itself
STYLE = STYLES["dark"]

DRONE = 100  # semantic id
#: Base colours, linear RGB.
COLORS: dict[str, Linear] = {
    "floor": (0.020, 0.028, 0.045),
    "grid": (0.035, 0.048, 0.075),
    "wall": (0.045, 0.060, 0.090),
    "pillar": (0.20, 0.27, 0.36),
    "body": (0.50, 0.52, 0.55),
    "arm": (0.22, 0.23, 0.25),
    "front": (0.85, 0.20, 0.02),
    "rear": (0.50, 0.55, 0.62),
    "waypoint": (1.0, 0.62, 0.05),
    "reached": (0.16, 0.20, 0.25),
    "goal": (0.05, 0.85, 0.25),
}
DRONE_COLORS, MARKER_COLORS = ("body", "arm", "front", "rear"), ("waypoint", "reached", "goal")


@dataclass
class Shown:
    """A flight, picture by picture."""

    position: Array
    """(T, 3) m: smoothed."""
    beams: list[tuple[Array, Array, Array]]
    """Start (3,) m and ends (K, 3) m of the LiDAR's beams, and which of them hit (K,)."""
    reached: Array
    """(T,): number of waypoints and goals that the drone has reached."""
    smoothed_m: float
    """Largest distance of the smoothed path to the flown one."""


def shown(world: flockstep.World, trail: Array) -> Shown:
    """Return the pictures' content for a flight with these positions (T, 3) m after each step.

    Raises
    ------
    RuntimeError
        The smoothed path touches something.
    """
    line = smooth(trail, SMOOTH_STEPS, mode="edge")
    steps_per_s = SPEED * flockstep.ClockConfig().policy_hz
    times = np.linspace(0, len(line) - 1, round((len(line) - 1) / steps_per_s * FPS) + 1)
    path = np.stack([np.interp(times, np.arange(len(line)), column) for column in line.T], axis=1)
    batch = flockstep.Batch([world], len(path), lidar=flockstep.LidarConfig())
    batch.set_pose(path.astype(np.float32))
    if batch.move(np.roll(path, -1, axis=0).astype(np.float32)).hit[:-1].any():
        raise RuntimeError("trail: expected a path that is free when smoothed, got one that touches something")
    batch.set_pose(path.astype(np.float32))
    batch.sense()
    places, reached = [*world.waypoints, world.goal], [0]
    for position in trail:
        count = reached[-1]
        at_next = count < len(places) and np.linalg.norm(position - places[count]) < GOAL_RADIUS_M
        reached.append(count + int(at_next))
    beams = [beams_of(batch, index) for index in range(len(path))]
    return Shown(
        path, beams, np.array(reached[1:])[times.astype(int)], float(np.linalg.norm(line - trail, axis=1).max())
    )


class Scene:
    """The playground with the drone, seen from a fixed place."""

    def __init__(self, world: flockstep.World, path: Array, size_px: tuple[int, int]) -> None:
        self.low, self.high = np.asarray(world.bounds, float)
        self.places = [*np.asarray(world.waypoints, float), np.asarray(world.goal, float)]
        self.pillars = [p for p in world.primitives if p["kind"] == "cylinder"]
        rotors = flockstep.DroneModel().to_dict()["rotors"]
        self.hubs, self.radius = np.asarray(rotors["position_m"], float), float(rotors["radius_m"])
        target = np.append((path.min(axis=0) + path.max(axis=0))[:2] / 2, 0.0) + TARGET_M
        self.viewer = target + AWAY_M
        self.turn = facing(self.viewer, target).astype(float)
        width, height = size_px
        self.camera = flockstep.CameraConfig(
            width_px=FINER * width,
            height_px=FINER * height,
            hfov_deg=HFOV_DEG,
            outputs=("rgb", "depth", "semantic"),
            shadows=True,
        )

    def picture(self, flight: Shown, index: int) -> Image.Image:
        """Return one picture."""
        position, reached = flight.position[index], int(flight.reached[index])
        # Rotors are rings in one picture and discs in the other. The mean has transparent discs and their shadows.
        rings, discs = (self._taken(self._world(position, reached, discs=discs)) for discs in (False, True))
        drone = self._taken(self._drone_alone(position))
        is_drone, is_hidden = drone["semantic"] == DRONE, rings["semantic"] != DRONE
        rgb = blended(discs["rgb"], rings["rgb"], np.array([0.6]))
        rgb[is_drone & is_hidden] = blended(rgb, drone["rgb"], np.array([GHOST]))[is_drone & is_hidden]
        origin, ends, hit = flight.beams[index]
        for surfaces, share in ((np.full_like(rings["depth"], np.inf), THROUGH), (rings["depth"], 1.0)):
            depth = np.where(is_drone, np.float32(0), surfaces)  # nothing is drawn over the drone
            canvas = DepthCanvas(rgb, depth, self.camera, self.viewer, self.turn, DARK_LIGHT)
            draw_beams(canvas, STYLE, origin, ends, hit, FINER + 1, share)
            for pictures in (index, *TRAIL):
                trail = flight.position[max(index - pictures, 0) : index + 1]
                canvas.lines(trail[:-1], trail[1:], STYLE.trail, width_px=4 * FINER, opacity=TRAIL_OPACITY * share)
        canvas.dots(ends[hit], STYLE.hit, size_px=5 * FINER)
        return Image.fromarray(rgb).reduce(FINER)

    def _taken(self, world: flockstep.World) -> dict[str, Array]:
        return render(world, self.viewer, self.turn, camera=self.camera)

    def _drone_alone(self, position: Array) -> flockstep.World:
        builder, materials = begun()
        self._add_drone(builder, materials, position, discs=False)
        return builder.build()

    def _world(self, position: Array, reached: int, discs: bool) -> flockstep.World:
        builder, m = begun()
        self._add_drone(builder, m, position, discs)
        (left, near, floor), (right, far, _) = self.low, self.high
        x, y, width, length = (left + right) / 2, (near + far) / 2, right - left, far - near
        add_floor(builder, self.low, self.high, m["floor"], m["grid"])
        for at, height in ((left - WALL_M / 2, LOW_M), (right + WALL_M / 2, CUT_M)):
            builder.box((at, y, floor + height / 2), (WALL_M, length + 2 * WALL_M, height), m["wall"])
        for at, height in ((near - WALL_M / 2, LOW_M), (far + WALL_M / 2, CUT_M)):
            builder.box((x, at, floor + height / 2), (width, WALL_M, height), m["wall"])
        for pillar in self.pillars:
            at = pillar["center"]
            builder.cylinder((at[0], at[1], floor + CUT_M / 2), pillar["half_extents"][0], CUT_M, m["pillar"])
        for index, place in enumerate(self.places):
            is_goal, is_reached = index == len(self.places) - 1, index < reached
            material = m["goal" if is_goal else "reached" if is_reached else "waypoint"]
            ground = np.array([place[0], place[1], floor + 0.02])
            builder.mesh(*torus(ground, GOAL_RADIUS_M, 0.022), material)
            if not is_reached:
                builder.sphere(beside(place), 0.11, material)
                builder.cylinder(beside((ground + place) / 2), 0.014, place[2] - floor, material)
            elif is_goal:
                builder.disc(beside(ground), GOAL_RADIUS_M, material)
        return builder.build()

    def _add_drone(self, builder: flockstep.WorldBuilder, m: dict[str, int], position: Array, discs: bool) -> None:
        builder.box(beside(position, z=-0.01), (0.30, 0.20, 0.09), m["body"])
        builder.box(beside(position, x=0.13), (0.06, 0.10, 0.06), m["front"])
        builder.cylinder(beside(position, z=0.075), 0.06, 0.08, m["arm"])  # the LiDAR
        for x, y, z in self.hubs:
            hub, half_yaw = beside(position, x, y, z), np.arctan2(y, x) / 2
            turn = (np.cos(half_yaw), 0, 0, np.sin(half_yaw))
            builder.box(beside(position, x / 2, y / 2, z), (np.hypot(x, y), 0.035, 0.03), m["arm"], turn)
            builder.cylinder(beside(hub, z=0.02), 0.03, 0.07, m["arm"])
            color, disc = m["front" if x > 0 else "rear"], beside(hub, z=ROTOR_Z_M)
            builder.mesh(*torus(disc, self.radius, 0.016), color)
            if discs:
                builder.disc(disc, self.radius, color)


def begun() -> tuple[flockstep.WorldBuilder, dict[str, int]]:
    """Return a world to build, with its light, and its materials by name."""
    builder = flockstep.WorldBuilder("film")
    builder.light(**DARK_LIGHT)
    materials = {}
    for name, color in COLORS.items():
        glow = tuple(0.35 * channel if name in MARKER_COLORS else 0.0 for channel in color)
        materials[name] = builder.material(name, color, semantic=DRONE if name in DRONE_COLORS else 0, emissive=glow)
    return builder, materials


def beside(position: npt.ArrayLike, x: float = 0, y: float = 0, z: float = 0) -> tuple[float, float, float]:
    """Return a position (3,) m moved by x, y and z."""
    at = np.asarray(position, float)
    return float(at[0] + x), float(at[1] + y), float(at[2] + z)


def torus(center: npt.ArrayLike, radius: float, thickness: float) -> tuple[Array, Array]:
    """Return vertices and triangles of a level ring; ``thickness`` is the radius of its section."""
    around, across = 64, 8
    i, j = (each.ravel() for each in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    a, b = 2 * np.pi * i / around, 2 * np.pi * j / across
    reach = radius + thickness * np.cos(b)
    vertices = np.asarray(center) + np.stack([reach * np.cos(a), reach * np.sin(a), thickness * np.sin(b)], axis=1)
    next_i, next_j = (i + 1) % around, (j + 1) % across
    corner, beside = i * across + j, next_i * across + j
    opposite, above = next_i * across + next_j, i * across + next_j
    return vertices, np.concatenate([np.stack([corner, beside, opposite], 1), np.stack([corner, opposite, above], 1)])


def frames(shot: Shot) -> Iterator[Frame]:
    """Fly, and draw the smoothed flight."""
    world = flockstep.World.playground(shot.seed, pillars=PILLARS)
    (flight,) = fly(greedy(shot.model), [world], MAX_STEPS)
    content = shown(world, flight.trail.astype(float))
    scene = Scene(world, content.position, (shot.width_px, shot.width_px * 9 // 16))
    last = shot.steps(1000 / FPS, len(content.position) - 1)
    for index in range(last + 1):
        yield scene.picture(content, index), HOLD_MS if index == last else round(1000 / FPS)
    print(
        f"{flight.outcome} after {flight.steps} steps, {flight.path_length_m:.1f} m. The path of the film is at most "
        f"{content.smoothed_m:.2f} m off the flown one."
    )
