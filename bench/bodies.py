"""Costs of bodies: scans, the LiDAR task and cameras among bodies that move, and a tick of each script.

One thread, in processor time. The variants that are compared alternate.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

import flockstep
from flockstep import BodyConfig, BodyMotion
from timing import RUNS, Measured, Median, Timer, in_turns, median_ratio, timed

DRONES, STEPS = 1024, 60
ENVS, BODIES = 64, 64  # of the ticks of scripts
TICKS = 100
SIDE = 8  # SIDE x SIDE solids
CAMERAS, FRAMES = 64, 10  # drones with a camera, and frames of each in a run
RINGS = 50  # of a torus of 2 RINGS x RINGS triangles
TILT_RAD = -0.7  # of the torus about y, which shows its hole to the cameras


def measure() -> Iterator[Measured]:
    yield from scans()
    yield from lidar_task()
    yield from cameras()
    yield from scripts()


def compared(name: str, rate: str, count: int, timers: dict[str, Timer]) -> Iterator[Measured]:
    """Return the rate of each variant, and its ratio to that of the same solids in the static world."""
    times = in_turns(timers, warm_up=True)
    for variant, seconds in times.items():
        yield f"bodies/{name}/{variant}/{rate}", count / Median(seconds), "1/s", RUNS
        if variant != "static":
            yield f"bodies/{name}/{variant}/ratio_to_static", median_ratio(times["static"], seconds), "1", RUNS


def hall(**more: Any) -> flockstep.World:
    """Return a hall of 20 m x 20 m with room for 64 solids."""
    markers = {"start": [10, 10, 1.5], "goal": [17.5, 17.5, 1.5]}
    scene = {"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [20, 20, 3]}, "markers": markers}
    return flockstep.World.from_dict(scene | more)


def solids() -> list[dict[str, Any]]:
    """Return 64 boxes, cylinders, spheres and capsules on a jittered grid, as fields of `BodyConfig`."""
    random = np.random.default_rng(0)
    shapes = ("box", "cylinder", "sphere", "capsule")
    found: list[dict[str, Any]] = []
    for i in range(SIDE * SIDE):
        shape, width = shapes[i % 4], float(random.uniform(0.3, 0.7))
        x, y = 2.5 * (np.array(divmod(i, SIDE)) + 0.5) + random.uniform(-0.3, 0.3, 2)
        height = width if shape == "sphere" else float(random.uniform(1, 2.5))
        found.append({"shape": shape, "size_m": [width, width, height], "position_m": [float(x), float(y), 1.5]})
    return found


def standing() -> flockstep.World:
    """Return the hall with the solids in its static world."""
    lists: dict[str, list[dict[str, Any]]] = {"boxes": [], "cylinders": [], "spheres": [], "capsules": []}
    names = {"box": "boxes", "cylinder": "cylinders", "sphere": "spheres", "capsule": "capsules"}
    for solid in solids():
        width, _, height = solid["size_m"]
        item: dict[str, Any] = {"center": solid["position_m"]}
        if solid["shape"] == "box":
            item["size"] = solid["size_m"]
        else:
            item["radius"] = width / 2
        if solid["shape"] in ("cylinder", "capsule"):
            item["height"] = height
        lists[names[solid["shape"]]].append(item)
    return hall(**lists)


def with_bodies(travel_m: float) -> flockstep.World:
    """Return the hall with the solids as bodies, which slide to and fro."""
    random = np.random.default_rng(1)
    bodies = []
    for solid in solids():
        angle = random.uniform(0, 2 * np.pi)
        travel = [travel_m * np.cos(angle), travel_m * np.sin(angle), 0]
        bodies.append(BodyConfig(**solid, motion=BodyMotion(kind="slider", travel_m=travel, period_s=4)))
    return hall().with_bodies(bodies)


def scans() -> Iterator[Measured]:
    """Scan with the default LiDAR from places between the solids, without moving anything meanwhile."""
    random = np.random.default_rng(2)
    places = np.full((DRONES, 3), 1.5, np.float32)
    places[:, :2] = 2.5 * random.integers(1, SIDE, (DRONES, 2))
    worlds = {"none": hall(), "static": standing(), "moving": with_bodies(0.3)}
    lidar = flockstep.LidarConfig()
    batches = {name: flockstep.Batch([world], DRONES, lidar=lidar, num_threads=1) for name, world in worlds.items()}
    for batch in batches.values():
        for _ in range(7):  # the bodies leave their initial places
            batch.move(places)
        batch.set_pose(places)
    yield from compared(
        "scans", "scans_per_second", DRONES, {name: timed(batch.sense, STEPS) for name, batch in batches.items()}
    )


def lidar_task() -> Iterator[Measured]:
    """Step the task under random actions, in steady state, including resets."""
    worlds = {"none": hall(), "static": standing(), "still": with_bodies(0.0), "moving": with_bodies(0.3)}
    actions = np.random.default_rng(0).integers(0, 6, (STEPS, DRONES))
    timers = {}
    for name, world in worlds.items():
        envs, turns = flockstep.DroneVectorEnv(DRONES, worlds=world, num_threads=1), itertools.cycle(actions)
        envs.reset(seed=0)
        for _ in range(1000):  # until drones are spread out and episodes end at a steady rate
            envs.step(next(turns))
        timers[name] = timed(lambda envs=envs, turns=turns: envs.step(next(turns)), STEPS)
    yield from compared("lidar_task", "steps_per_second", DRONES, timers)


def torus(center_m: tuple[float, float, float] | None = None) -> flockstep.World:
    """Return a torus of 5,000 triangles and 2 m: in its own frame, or tilted around a point in a room."""
    turn = 2 * np.pi * np.arange(RINGS) / RINGS
    along, around = (angle.ravel() for angle in np.meshgrid(turn, turn, indexing="ij"))
    radius = 0.65 + 0.3 * np.cos(around)
    vertices = np.stack([radius * np.cos(along), radius * np.sin(along), 0.3 * np.sin(around)], axis=1)
    first = np.arange(RINGS * RINGS).reshape(RINGS, RINGS)
    right, up = np.roll(first, -1, 0), np.roll(first, -1, 1)
    both = np.roll(right, -1, 1)
    triangles = np.concatenate([np.stack([first, right, both], -1), np.stack([first, both, up], -1)]).reshape(-1, 3)
    builder = flockstep.WorldBuilder()
    material = builder.material("steel", base_color=[0.5, 0.5, 0.6])
    if center_m is not None:
        builder.room([-10, -10, 0], [10, 10, 6], material)
        x, y, z = vertices.T
        cos, sin = np.cos(TILT_RAD), np.sin(TILT_RAD)
        vertices = np.stack([cos * x + sin * z, y, cos * z - sin * x], axis=1) + center_m
    builder.mesh(vertices, triangles, material)
    return builder.build()


def cameras() -> Iterator[Measured]:
    """Move drones and render 64 x 64 pixels of colour and depth of a torus, static and as a body that turns."""
    center = (2.0, 0.0, 3.0)
    camera = flockstep.CameraConfig(width_px=64, height_px=64, outputs=["rgb", "depth"])
    settings: dict[str, Any] = {"cameras": [camera], "num_threads": 1}
    room = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-10, -10, 0], "max": [10, 10, 6]}})
    tilt = [np.cos(TILT_RAD / 2), 0, np.sin(TILT_RAD / 2), 0]
    body: dict[str, Any] = {"shape": "mesh", "mesh": torus(), "position_m": center, "quat_wxyz": tilt}
    spin = BodyMotion(kind="orbit", center_m=center, axis=[np.sin(TILT_RAD), 0, np.cos(TILT_RAD)])  # its own axis
    batches = {
        "none": flockstep.Batch([room], CAMERAS, **settings),
        "static": flockstep.Batch([torus(center)], CAMERAS, **settings),
        "still": flockstep.Batch([room], CAMERAS, bodies=[BodyConfig(**body)], **settings),
        "moving": flockstep.Batch([room], CAMERAS, bodies=[BodyConfig(**body, motion=spin)], **settings),
    }
    places = np.array([0, 0, 3]) + np.random.default_rng(0).uniform(-0.3, 0.3, (CAMERAS, 3))
    timers = {
        name: timed(
            lambda batch=batch: (batch.move(places), batch.sense()),
            FRAMES,
            before=lambda batch=batch: batch.set_pose(places),
        )
        for name, batch in batches.items()
    }
    yield from compared("cameras", "frames_per_second", CAMERAS, timers)


def motions() -> dict[str, BodyMotion]:
    """Return a motion of each script around its position, and one that stands."""
    points = [[20, 0, 5], [25, 0, 5], [25, 5, 5], [20, 5, 5]]
    box = {"box_min_m": [20, -5, 3], "box_max_m": [30, 5, 7]}
    return {
        "standing": BodyMotion(),
        "velocity": BodyMotion(velocity_mps=[0.01, 0, 0], turn_rate_dps=[0, 0, 90]),
        "waypoints": BodyMotion(kind="waypoints", points_m=points),
        "waypoints, rounded": BodyMotion(kind="waypoints", points_m=points, corner_radius_m=1, faces_travel=True),
        "orbit": BodyMotion(kind="orbit", center_m=[25, 0, 5]),
        "hinge": BodyMotion(kind="hinge", center_m=[25, 0, 5]),
        "slider": BodyMotion(kind="slider", travel_m=[5, 0, 0]),
        "random_walk": BodyMotion(kind="random_walk", period_s=1, **box),
    }


def scripts() -> Iterator[Measured]:
    """Time a tick of a body by script. The drones stand 20 m away; a batch without bodies is subtracted."""
    clock = flockstep.ClockConfig(policy_hz=10, physics_hz=10 * TICKS)
    bare = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-100] * 3, "max": [100] * 3}})
    batches = {"none": flockstep.Batch([bare], ENVS, clock=clock, num_threads=1)}
    for name, motion in motions().items():
        body = BodyConfig(position_m=[20, 0, 5], motion=motion)
        batches[name] = flockstep.Batch([bare], ENVS, bodies=[body] * BODIES, clock=clock, num_threads=1)
    timers = {name: timed(lambda batch=batch: batch.move(batch.position)) for name, batch in batches.items()}
    times = in_turns(timers, warm_up=True)
    for name in motions():
        added = Median(a - b for a, b in zip(times[name], times["none"], strict=True))
        yield f"bodies/script/{name}/ns_per_tick", 1e9 * added / (TICKS * ENVS * BODIES), "ns", RUNS
