"""The rows that `./dev bench --against` times, by family. bench/compare.py runs this file in both checkouts.

A row uses only calls that both checkouts have: those of the public Python package, whose name may differ.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

Call = Callable[[], object]
Setup = Callable[[Any], Call]  # takes the imported package, returns the call to time
MakeWorlds = Callable[[Any], list[Any]]

GRID = {"channels": 16, "beams": 360, "hfov_deg": 360, "vfov_deg": 30, "max_range_m": 30}
DENSE_GRID = {"channels": 64, "beams": 1024, "hfov_deg": 360, "vfov_deg": 45, "max_range_m": 30}
FAN = {"channels": 1, "beams": 35, "hfov_deg": 270, "max_range_m": 30}

# --------------------------------------------------------------------------------------------------------------- worlds


def scene(package: Any, **fields: Any) -> Any:
    return package.World.from_dict({f"{package.__name__}_scene": 1, **fields})


def train(package: Any) -> list[Any]:
    return list(package.scenes.load("train"))


def playground(package: Any) -> list[Any]:
    return list(package.scenes.load("playground/camera-train-1"))


@functools.cache
def bundled(name: str) -> MakeWorlds:
    """Return a maker of one bundled world, which is loaded once and shared by the rows of a process."""
    return functools.cache(lambda package: list(package.scenes.load(name)))


def pillars(package: Any) -> list[Any]:
    rng = np.random.default_rng(1)
    placed = [{"center": center.tolist(), "radius": 0.25} for center in rng.uniform(-100, 100, (5000, 2))]
    return [scene(package, room={"min": [-100, -100, -2.5], "max": [100, 100, 2.5]}, pillars=placed)]


def rolling_ground(cells: int) -> tuple[Any, Any]:
    """Return vertices (V, 3) m and 2 * cells**2 triangles, with a thin spike for every 75 cells."""
    side = 0.3 * cells + 14
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(0, side, cells + 1)]))
    z = 1.2 * np.sin(0.21 * x) * np.cos(0.17 * y) + 0.4 * np.sin(0.9 * x + 0.5 * y) + 0.15 * np.sin(2.3 * y)
    spikes = np.random.default_rng(1).integers(0, len(x), cells * cells // 75 + 1)
    z[spikes] += 3.5
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    lower = np.stack([corner, corner + 1, corner + cells + 2], axis=1)
    upper = np.stack([corner, corner + cells + 2, corner + cells + 1], axis=1)
    return np.stack([x, y, z], axis=1), np.concatenate([lower, upper])


@functools.cache
def hills(cells: int) -> MakeWorlds:
    """Return a maker of a `rolling_ground` world."""

    def make(package: Any) -> list[Any]:
        vertices, triangles = rolling_ground(cells)
        return [scene(package, meshes=[{"vertices": vertices.tolist(), "triangles": triangles.tolist()}])]

    return functools.cache(make)


def small_room(package: Any) -> list[Any]:
    """Return a room in which a drone under random actions soon hits something."""
    return [
        scene(
            package,
            room={"min": [-2, -2, 0], "max": [2, 2, 3]},
            boxes=[{"center": [1, 1, 0.5], "size": [0.8, 0.8, 1]}],
            markers={"start": [0, 0, 1.5], "goal": [0, 0, 1.5]},
        )
    ]


HALF_ROOM_M = 50.0
PILLAR = (-30.0, -30.0, 0.0)


def large_room(package: Any) -> list[Any]:
    walls = {"min": [-HALF_ROOM_M] * 3, "max": [HALF_ROOM_M] * 3}
    return [scene(package, room=walls, cylinders=[{"center": PILLAR, "radius": 1.0, "height": 4.0}])]


# ---------------------------------------------------------------------------------------------------- step: whole steps


def stepping(n: int, warm_up: int = 300, **settings: Any) -> Setup:
    told = {"worlds": "train", "num_threads": 1} | settings
    return lambda package: stepped(package.DroneVectorEnv(n, **told), warm_up)


def flying(n: int, task: str, imu: bool = False, in_small_room: bool = False, **settings: Any) -> Setup:
    """Return a setup of a task with simulated rotors. `wind` holds the fields of a WindConfig."""

    def setup(package: Any) -> Call:
        options: dict[str, Any] = {"task": getattr(package, task)(), "num_threads": 1} | settings
        if "wind" in options:
            options["wind"] = package.WindConfig(**options["wind"])
        if imu:
            options["imu"] = noisy_imu(package)
        if in_small_room:
            options["worlds"] = small_room(package)
        return stepped(package.DroneVectorEnv(n, **options), 200)

    return setup


NOISES = ("noise_density", "random_walk")


def noisy_imu(package: Any, **settings: Any) -> Any:
    noise = {f"{sensor}_{kind}": 0.01 for sensor in ("accelerometer", "gyroscope") for kind in NOISES}
    return package.ImuConfig(**noise | settings)


def example_task(n: int, worlds: str, module: str, task: str, *configs: str) -> Setup:
    """Return a setup of a task in a module of examples/, made with default configurations."""

    def setup(package: Any) -> Call:
        sys.path.insert(0, str(Path.cwd() / "examples"))
        made = getattr(importlib.import_module(module), task)(*(getattr(package, name)() for name in configs))
        return stepped(package.DroneVectorEnv(n, worlds=worlds, task=made, num_threads=1), 100)

    return setup


def stepped(envs: Any, warm_up: int, reach: float = 1.0) -> Call:
    """Return a function that steps with random actions, those of a box up to `reach`."""
    envs.reset(seed=0)
    rng, space = np.random.default_rng(0), envs.single_action_space
    if hasattr(space, "n"):
        actions = rng.integers(0, space.n, (64, envs.num_envs))
    else:
        actions = rng.uniform(-reach, reach, (64, envs.num_envs, *space.shape)).astype(np.float32)
    turns = itertools.cycle(actions)

    def step() -> None:
        envs.step(next(turns))

    for _ in range(warm_up):  # until drones are spread out and episodes end at a steady rate
        step()
    return step


STEP: list[tuple[str, Setup]] = [
    *((f"step/n{n}", stepping(n, 500 if n < 4096 else 200)) for n in (1, 16, 256, 1024, 4096)),
    ("step/views_n1024", stepping(1024, copy=False)),
    ("step/same_step_n256", stepping(256, autoreset_mode="same_step", max_episode_steps=50)),
    ("step/random_start_and_world_n256", stepping(256, random_start=True, random_world=True, max_episode_steps=50)),
    ("step/displacement_yaw_n256", stepping(256, action="displacement_yaw")),
    ("step/camera_n64", stepping(64, worlds="camera-train", observation="blob")),
    ("step/pixels_n64", stepping(64, worlds="camera-train", observation="pixels")),
    (
        "step/numpy_task_n1024",
        example_task(1024, "train", "navigation_numpy", "Navigation", "NavigationConfig", "LidarConfig"),
    ),
    ("step/terms_task_n1024", example_task(1024, "train", "navigation_terms", "Navigation")),
    (
        "step/reset_n1024",
        lambda package: partial(package.DroneVectorEnv(1024, worlds="train", num_threads=1).reset, seed=0),
    ),
    ("step/hover_n1", flying(1, "HoverConfig")),
    ("step/hover_n1024", flying(1024, "HoverConfig")),
    ("step/hover_views_n1024", flying(1024, "HoverConfig", copy=False)),
    ("step/hover_body_rates_n4096", flying(4096, "HoverConfig", control="body_rates", policy_hz=100, copy=False)),
    ("step/hover_stop_n256", flying(256, "HoverConfig", in_small_room=True, on_contact="stop")),
    (
        "step/hover_stop_dryden_imu_n256",
        flying(256, "HoverConfig", imu=True, in_small_room=True, on_contact="stop", wind={"gusts": "dryden"}),
    ),
    ("step/track_n1024", flying(1024, "TrackConfig")),
    ("step/track_velocity_n1024", flying(1024, "TrackConfig", control="velocity")),
    ("step/track_bounce_n256", flying(256, "TrackConfig", in_small_room=True, on_contact="bounce", max_distance_m=10)),
    ("step/race_n1024", flying(1024, "RaceConfig")),
    ("step/track_gusts_imu_n1024", flying(1024, "TrackConfig", imu=True, wind={"gusts": "ornstein_uhlenbeck"})),
]

# -------------------------------------------------------------------------------- lidar, camera and tiles: sensors only


def turned(n: int) -> Any:
    """Return quaternions (n, 4) of random yaws."""
    half_yaw = np.random.default_rng(2).uniform(0, math.pi, n)
    zero = np.zeros(n)
    return np.stack([np.cos(half_yaw), zero, zero, np.sin(half_yaw)], axis=1).astype(np.float32)


def somewhere(package: Any, worlds: list[Any], n: int, **settings: Any) -> Any:
    """Return a batch of n drones at free positions of their worlds, with random yaws."""
    batch = package.Batch(worlds, n, **{"num_threads": 1} | settings)
    position = np.zeros((n, 3), np.float32)
    for i, world in enumerate(worlds[:n]):
        position[i :: len(worlds)] = world.free_places(len(range(i, n, len(worlds))), seed=0)
    batch.set_pose(position, turned(n))
    return batch


def sensing(package: Any, make_worlds: MakeWorlds, n: int, **settings: Any) -> Call:
    sense: Call = somewhere(package, make_worlds(package), n, **settings).sense
    return sense


def measuring(make_worlds: MakeWorlds, n: int, lidar: dict[str, Any], tracer: str = "tiles") -> Setup:
    return lambda package: sensing(package, make_worlds, n, lidar=package.LidarConfig(**lidar), tracer=tracer)


def seeing(
    make_worlds: MakeWorlds,
    width: int,
    height: int,
    n: int,
    tracer: str = "tiles",
    backend: str = "raycast",
    **camera: Any,
) -> Setup:
    def setup(package: Any) -> Call:
        config = package.CameraConfig(width_px=width, height_px=height, hfov_deg=90.0, **camera)
        return sensing(package, make_worlds, n, cameras=[config], tracer=tracer, camera_backend=backend)

    return setup


def drawing(backend: str, make_worlds: MakeWorlds, width: int, height: int, n: int) -> Setup:
    return seeing(make_worlds, width, height, n, "auto", backend, outputs=["rgb", "depth"])


def capturing(mode: str | None, moving: bool, make_worlds: MakeWorlds = playground) -> Setup:
    """Return a setup of `Batch.sense` with a camera in a mode, or without one."""

    def setup(package: Any) -> Call:
        settings = {"width_px": 64, "height_px": 64, "outputs": ["rgb", "depth"], "capture_mode": mode}
        cameras = [package.CameraConfig(**settings)] if mode else []
        batch = somewhere(package, make_worlds(package), 64, cameras=cameras)
        position = batch.position.copy()
        positions = [position, position + np.array([0, 0, 0.01], np.float32)]

        def sense() -> None:
            if moving:
                positions.reverse()
                batch.set_pose(positions[0])
            batch.sense()

        return sense

    return setup


LIDAR: list[tuple[str, Setup]] = [
    ("lidar/fan35x1024", measuring(train, 1024, {}, "auto")),
    ("lidar/grid16x360x64", measuring(train, 64, GRID, "auto")),
    ("lidar/forest_fan35x1024", measuring(pillars, 1024, {}, "auto")),
    ("lidar/mesh_fan35x1024", measuring(hills(40), 1024, {}, "auto")),
    ("lidar/mesh_grid16x360x16", measuring(hills(40), 16, GRID, "auto")),
]
CAMERA: list[tuple[str, Setup]] = [
    ("camera/raycast/playground/64x64x64", drawing("raycast", playground, 64, 64, 64)),
    ("camera/raycast/playground/640x480x2", drawing("raycast", playground, 640, 480, 2)),
    ("camera/raycast/mesh1k/64x64x16", drawing("raycast", hills(22), 64, 64, 16)),
    ("camera/raycast/mesh100k/64x64x16", drawing("raycast", hills(220), 64, 64, 16)),
    ("camera/raycast/mesh1k/640x480x1", drawing("raycast", hills(22), 640, 480, 1)),
    ("camera/gl/playground/64x64x64", drawing("gl", playground, 64, 64, 64)),
    ("camera/gl/mesh1k/64x64x64", drawing("gl", hills(22), 64, 64, 64)),
    ("camera/modes/on_movement/still", capturing("on_movement", moving=False)),
    ("camera/modes/on_demand/moving", capturing("on_demand", moving=True)),
]

OFFICE, WAREHOUSE, FOREST, CITY = (
    bundled(name) for name in ("indoor/office", "indoor/warehouse", "outdoor/forest", "outdoor/city")
)
IDS = ["depth", "semantic", "instance", "normal"]

TILES: list[tuple[str, Setup]] = [
    ("tiles/hills1k/depth64x64x64", seeing(hills(22), 64, 64, 64, outputs=["depth"])),
    ("tiles/hills1k/grid16x360x16", measuring(hills(22), 16, GRID)),
    ("tiles/hills100k/depth64x64x16", seeing(hills(220), 64, 64, 16, outputs=["depth"])),
    ("tiles/hills100k/grid64x1024x1", measuring(hills(220), 1, DENSE_GRID)),
    ("tiles/office/depth32x24x256", seeing(OFFICE, 32, 24, 256, outputs=["depth"])),
    ("tiles/office/depth640x480x4", seeing(OFFICE, 640, 480, 4, outputs=["depth"])),
    ("tiles/office/rgb32x24x256", seeing(OFFICE, 32, 24, 256)),
    ("tiles/office/ids64x64x32", seeing(OFFICE, 64, 64, 32, outputs=IDS)),
    ("tiles/office/grid16x360x16", measuring(OFFICE, 16, GRID)),
    ("tiles/office/fan35x1024", measuring(OFFICE, 1024, FAN, "auto")),
    ("tiles/forest/rgb64x64x32", seeing(FOREST, 64, 64, 32)),
    ("tiles/forest/grid16x360x16", measuring(FOREST, 16, GRID)),
    ("tiles/city/depth64x64x16", seeing(CITY, 64, 64, 16, outputs=["depth"])),
    ("tiles/city/rgb64x64x16", seeing(CITY, 64, 64, 16, far_m=1000.0)),
    ("tiles/city/shadows64x64x16", seeing(CITY, 64, 64, 16, far_m=1000.0, shadows=True)),
    ("tiles/city/four_samples64x64x8", seeing(CITY, 64, 64, 8, far_m=1000.0, samples_per_pixel=4)),
    ("tiles/city/resized64x48x8", seeing(CITY, 64, 48, 8, resize=(32, 24), outputs=["rgb", "depth", "hsv", "grey"])),
]

# ------------------------------------------------------------------------------------------------ dynamics: motion only


def fleet(
    control: str,
    height_m: float = HALF_ROOM_M,
    commanded_m: float | None = None,
    place: tuple[float, float] = (0.0, 0.0),
    commanded_place: tuple[float, float] | None = None,
    spread_m: float = 5.0,
    n: int = 1024,
    imu: bool = False,
    senses: bool = False,
    settle: int = 100,
    **dynamics: Any,
) -> Setup:
    """Return a setup of `Batch.fly` at 100 Hz with 5 ticks per step, with drones near a position in the large room.

    Heights are those of the drones' centres above the floor. Position commands lead to `commanded_m` and
    `commanded_place`, by default to the drones' own positions.
    """

    def setup(package: Any) -> Call:
        config = {"motion": "rotors", "control": control} | dynamics
        if "wind" in config:
            config["wind"] = package.WindConfig(**config["wind"])
        batch = package.Batch(
            large_room(package),
            n,
            drone="kingfisher",
            dynamics=package.DynamicsConfig(**config),
            clock=package.ClockConfig(policy_hz=100, physics_hz=500),
            imu=noisy_imu(package) if imu else None,
            num_threads=1,
        )
        aside = np.random.default_rng(1).uniform(-spread_m, spread_m, (n, 2))
        target = commanded_m if commanded_m is not None else height_m
        at = np.column_stack([aside + place, np.full(n, height_m - HALF_ROOM_M)])
        to = np.column_stack([aside + (commanded_place or place), np.full(n, target - HALF_ROOM_M)])
        batch.set_pose(at)
        if control == "position":
            command = np.column_stack([to, np.zeros(n)])
        elif control == "rotor_speeds":
            command = np.full((n, 4), package.DroneModel.load("kingfisher").hover_speed_radps)
        elif control in ("body_rates", "attitude"):
            command = np.tile([9.81, 0, 0, 0], (n, 1))
        else:
            command = np.zeros((n, 4))  # zero velocity or acceleration: stay
        command = command.astype(np.float32)

        def fly() -> None:
            batch.fly(command)
            if imu or senses:
                batch.sense()

        for _ in range(settle):  # until the drones have arrived at their targets or at an obstacle
            fly()
        return fly

    return setup


def moving(amplitude_m: float) -> Setup:
    """Return a setup of kinematic moves back and forth in playgrounds; long ones end at pillars and walls."""

    def setup(package: Any) -> Call:
        batch = somewhere(package, train(package), 1024)
        position = batch.position.copy()
        away = np.random.default_rng(3).uniform(-amplitude_m, amplitude_m, position.shape).astype(np.float32)
        places, quats = (
            itertools.cycle([position + away, position]),
            itertools.cycle([turned(1024)[::-1], turned(1024)]),
        )

        def move() -> None:
            batch.move(next(places), next(quats))

        return move

    return setup


CORNER = (HALF_ROOM_M - 0.25,) * 2
BEYOND_CORNER = (HALF_ROOM_M + 3.0,) * 2


def pressed(on_contact: str) -> Setup:
    return fleet("position", 0.3, -0.2, on_contact=on_contact, n=256, settle=200)


def cornered(on_contact: str) -> Setup:
    return fleet("position", 0.25, -1.0, CORNER, BEYOND_CORNER, 0.05, on_contact=on_contact, n=64, settle=200)


def inside_pillar(on_contact: str) -> Setup:
    return fleet("position", HALF_ROOM_M, place=PILLAR[:2], spread_m=0.1, n=64, on_contact=on_contact)


DYNAMICS: list[tuple[str, Setup]] = [
    ("dynamics/rotor_speeds_n4096", fleet("rotor_speeds", n=4096)),
    ("dynamics/rotor_speeds_midpoint_n1024", fleet("rotor_speeds", integrator="midpoint")),
    ("dynamics/body_rates_n4096", fleet("body_rates", n=4096)),
    ("dynamics/body_rates_n16", fleet("body_rates", n=16)),
    ("dynamics/attitude_n1024", fleet("attitude")),
    ("dynamics/acceleration_n1024", fleet("acceleration")),
    ("dynamics/velocity_n1024", fleet("velocity")),
    ("dynamics/position_n1024", fleet("position")),
    ("dynamics/gusts_n1024", fleet("position", wind={"gusts": "ornstein_uhlenbeck", "mean_mps": (3, 1, 0)})),
    ("dynamics/dryden_n1024", fleet("position", wind={"gusts": "dryden", "mean_mps": (3, 1, 0)})),
    ("dynamics/imu_n1024", fleet("position", imu=True)),
    ("dynamics/near_floor_n1024", fleet("position", 0.5)),
    ("dynamics/ground_effect_near_floor_n1024", fleet("position", 0.5, ground_effect=True)),
    ("dynamics/ground_effect_far_above_n1024", fleet("position", ground_effect=True)),
    *((f"dynamics/on_floor_{way}_n256", pressed(way)) for way in ("terminate", "stop", "bounce")),
    *((f"dynamics/in_corner_{way}_n64", cornered(way)) for way in ("stop", "bounce")),
    ("dynamics/inside_pillar_stop_n64", inside_pillar("stop")),
    ("dynamics/move_short_n1024", moving(0.1)),
    ("dynamics/move_long_n1024", moving(3.0)),
]

# ----------------------------------------------------------------- worlds: loading, generating, preparing, drawing them


@functools.cache
def temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """Return the folder of the rows' files. It is deleted when the process ends."""
    return tempfile.TemporaryDirectory()


def file(name: str) -> Path:
    return Path(temporary_folder().name) / name


def loading(write: Callable[[Any], Path]) -> Setup:
    return lambda package: partial(package.World.load, write(package))


def json_file(package: Any) -> Path:
    """Write 5,000 spheres with 500 materials."""
    centers = np.random.default_rng(0).uniform(-500, 500, (5000, 3)).round(3).tolist()
    path = file("spheres.json")
    path.write_text(
        json.dumps(
            {
                f"{package.__name__}_scene": 1,
                "materials": {f"m{i}": {"base_color": [0.5, 0.5, 0.5]} for i in range(500)},
                "spheres": [
                    {"center": center, "radius": 0.1, "material": f"m{i % 500}"} for i, center in enumerate(centers)
                ],
            }
        )
    )
    return path


def glb_file(package: Any) -> Path:
    """Write the generated office: triangles, textures and primitives."""
    path = file("office.glb")
    OFFICE(package)[0].save(path)
    return path


def obj_file(package: Any) -> Path:
    vertices, triangles = rolling_ground(100)
    path = file("hills.obj")
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path


def ply_file(package: Any) -> Path:
    vertices, triangles = rolling_ground(220)
    path = file("hills.ply")
    header = f"""ply
format binary_little_endian 1.0
element vertex {len(vertices)}
property float x
property float y
property float z
element face {len(triangles)}
property list uchar int vertex_indices
end_header
"""
    faces = np.empty(len(triangles), [("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, triangles
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())
    return path


def saving(suffix: str) -> Setup:
    return lambda package: partial(FOREST(package)[0].save, file(f"saved{suffix}"))


def generating(name: str, **settings: Any) -> Setup:
    return lambda package: partial(getattr(package.World, name), 1, **settings)


def preparing(write: Callable[[Any], Path], outputs: list[str], tracer: str = "auto") -> Setup:
    """Return a setup that loads a file, then takes a first scan and frame, which prepare the world for both."""

    def setup(package: Any) -> Call:
        path = write(package)
        camera = package.CameraConfig(width_px=64, height_px=64, outputs=outputs)
        lidar = package.LidarConfig(**GRID)

        def prepare() -> None:
            world = package.World.load(path)
            package.Batch([world], lidar=lidar, cameras=[camera], tracer=tracer, num_threads=1).sense()

        return prepare

    return setup


def pooled(n: int, size: int) -> Setup:
    """Return a setup of steps with short episodes, each of which draws one of `size` finished worlds."""

    def setup(package: Any) -> Call:
        pool = package.WorldPool(package.World.playground, size=size)
        return stepped(package.DroneVectorEnv(n, worlds=pool, max_episode_steps=10, num_threads=1), 100)

    return setup


def pool_filling(package: Any) -> Call:
    """Reset envs once in newly built worlds."""

    def fill() -> None:
        pool = package.WorldPool(package.World.playground, size=16)
        package.DroneVectorEnv(64, worlds=pool, num_threads=1).reset(seed=0)

    return fill


WORLDS: list[tuple[str, Setup]] = [
    ("worlds/load/playground", lambda package: partial(package.World.load, "playground/train-1")),
    ("worlds/load/json", loading(json_file)),
    ("worlds/load/glb", loading(glb_file)),
    ("worlds/load/obj", loading(obj_file)),
    ("worlds/load/ply", loading(ply_file)),
    ("worlds/load/dict", lambda package: partial(package.World.from_dict, FOREST(package)[0].to_dict())),
    ("worlds/save/json", saving(".json")),
    ("worlds/save/glb", saving(".glb")),
    ("worlds/generate/playground", generating("playground")),
    ("worlds/generate/forest", generating("forest", trees=40, size_m=(30, 20))),
    ("worlds/generate/office", generating("office", size_m=(20, 14))),
    ("worlds/generate/warehouse", generating("warehouse", size_m=(26, 16))),
    ("worlds/generate/city", generating("city", blocks=(1, 1))),
    ("worlds/prepare/json", preparing(json_file, ["rgb"])),
    ("worlds/prepare/glb", preparing(glb_file, ["rgb"])),
    ("worlds/prepare/glb_embree", preparing(glb_file, ["depth"], "embree")),
    ("worlds/prepare/obj", preparing(obj_file, ["depth"])),
    ("worlds/pool/episodes_n256", pooled(256, 32)),
    ("worlds/pool/fill_n64", pool_filling),
    ("worlds/free_places", lambda package: partial(OFFICE(package)[0].free_places, 256, seed=0)),
    ("worlds/occupancy", lambda package: partial(OFFICE(package)[0].occupancy, 0.5)),
    *(
        (f"worlds/{name}/{sensor}", setup)
        for name in ("bench/complex", "bench/simple", "indoor/warehouse", "outdoor/city", "outdoor/forest")
        for sensor, setup in (
            ("fan35x256", measuring(bundled(name), 256, FAN | {"max_range_m": 100}, "auto")),
            ("camera64x64x16", seeing(bundled(name), 64, 64, 16, "auto", far_m=1000.0, outputs=["rgb", "depth"])),
        )
    ),
    ("worlds/indoor/office/depth_to_goal_n64", example_task(64, "indoor/office", "depth_to_goal", "DepthToGoal")),
]

ROWS = [*STEP, *LIDAR, *CAMERA, *TILES, *DYNAMICS, *WORLDS]
