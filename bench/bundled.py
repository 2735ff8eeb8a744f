"""Speed of LiDARs and cameras in every bundled world, and the cost of loading many triangles."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import flockstep

RUNS = 5
DRONES = 256
#: Sensors and numbers of drones, by the name of their figures.
LIDARS = {
    "fan35": flockstep.LidarConfig(channels=1, beams=35, hfov_deg=270.0, max_range_m=100.0),
    "grid16x360": flockstep.LidarConfig(channels=16, beams=360, hfov_deg=360.0, vfov_deg=30.0, max_range_m=100.0),
}
SIZES_PX = {"camera64x64": ((64, 64), DRONES), "camera640x480": ((640, 480), 4)}

Measured = tuple[str, float, str, int]  # name, value, unit, runs


def seconds_per_sense(batch: flockstep.Batch, at_least_s: float = 0.1) -> float:
    count, before = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - before) < at_least_s:
        batch.sense()
        count += 1
    return elapsed / count


def turned(count: int) -> Any:
    """Return quaternions of evenly spaced yaws."""
    half = np.linspace(0, np.pi, count, dtype=np.float32)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)


def sensing(world: flockstep.World, places: Any, **sensors: Any) -> flockstep.Batch:
    """Return a batch of drones at given positions, each with a different yaw."""
    batch = flockstep.Batch([world], len(places), num_threads=1, **sensors)
    batch.set_pose(places, turned(len(places)))
    batch.sense()
    return batch


def measure() -> list[Measured]:
    """Time LiDAR scans and frames with depth on one thread, at random positions in free space."""
    found: list[Measured] = []
    for name in flockstep.scenes.names():
        (world,) = flockstep.scenes.load(name)
        places = world.free_places(DRONES, seed=0)
        batches = {sensor: sensing(world, places, lidar=lidar) for sensor, lidar in LIDARS.items()}
        for sensor, ((width, height), count) in SIZES_PX.items():
            camera = flockstep.CameraConfig(
                width_px=width, height_px=height, hfov_deg=90.0, far_m=1000.0, outputs=("rgb", "depth")
            )
            batches[sensor] = sensing(world, places[:count], cameras=[camera])
        times: dict[str, list[float]] = {sensor: [] for sensor in batches}
        for _ in range(RUNS):
            for sensor, batch in batches.items():
                times[sensor].append(seconds_per_sense(batch))
        found.append((f"worlds/{name}/triangles", float(world.check()["triangles"]), "1", 1))
        for sensor, batch in batches.items():
            rate = batch.num_drones / statistics.median(times[sensor])
            packets = batch.embree_packets
            batch.sense()
            found += [
                (f"worlds/{name}/{sensor}_per_second", rate, "1/s", RUNS),
                (f"worlds/{name}/{sensor}_embree_packets", (batch.embree_packets - packets) / batch.num_drones, "1", 1),
            ]
    return found


def measure_steps() -> list[Measured]:
    """Time whole steps of examples/depth_to_goal.py, 64 x 48 pixels of depth, and the share of rendering.

    It runs on one thread under random actions from positions all over the worlds. Whole steps and rendering alternate.
    """
    sys.path.append(str(Path(__file__).resolve().parent.parent / "examples"))
    from depth_to_goal import DepthToGoal  # type: ignore[import-not-found]

    found: list[Measured] = []
    for name in ("indoor/office", "outdoor/forest"):
        (world,) = flockstep.scenes.load(name)
        places = world.free_places(DRONES, seed=0)

        class FromAllOver(DepthToGoal):  # type: ignore[misc] # module without types
            def reset(self, batch: flockstep.Batch, mask: Any) -> None:
                super().reset(batch, mask)
                batch.set_pose(places, turned(DRONES), mask)  # noqa: B023 - used only in this iteration
                self.last_distance[mask] = batch.terms.goal_distance()[mask]

        envs = flockstep.DroneVectorEnv(DRONES, worlds=world, task=FromAllOver(), num_threads=1, copy=False)
        envs.reset(seed=0)
        actions = np.random.default_rng(0).uniform(-1, 1, (300, *envs.action_space.shape)).astype(np.float32)
        times: dict[str, list[float]] = {"step": [], "sense": []}
        for run in range(RUNS + 1):  # drones are spread out before the first measured run
            before = time.perf_counter()
            for told in actions:
                envs.step(told)
            took = (time.perf_counter() - before) / len(actions)
            if run > 0:
                times["step"].append(took)
                times["sense"].append(seconds_per_sense(envs.batch))
        shares = [sense / step for sense, step in zip(times["sense"], times["step"], strict=True)]
        rate = DRONES / statistics.median(times["step"])
        found += [
            (f"worlds/{name}/depth64x48_steps_per_second", rate, "1/s", RUNS),
            (f"worlds/{name}/depth64x48_share_of_rendering", statistics.median(shares), "1", RUNS),
        ]
    return found


#: Costs of images of one world, with and without features that make them realistic.
LOOKS_IN = "outdoor/city"
LOOKS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {  # features removed from the world, settings of the camera
    "as_it_is": ((), {}),
    "shadows": ((), {"shadows": True}),
    "four_samples": ((), {"samples_per_pixel": 4}),
    "no_textures": (("textures",), {}),
    "no_disc_of_the_sun": (("sun",), {}),
}


def plainer(world: flockstep.World, without: tuple[str, ...]) -> flockstep.World:
    """Return the world without its textures, or without the sun in its sky."""
    data = world.to_dict()
    if "textures" in without:
        del data["textures"]
        for material in data["materials"].values():
            material.pop("texture", None)
    if "sun" in without:
        data["light"].update(sun_radius_deg=0.0, sun_glow=0.0)
    return flockstep.World.from_dict(data)


def measure_looks() -> list[Measured]:
    """Time frames of 320 x 240 on one thread, with and without features that make them realistic."""
    (world,) = flockstep.scenes.load(LOOKS_IN)
    places = world.free_places(8, seed=0)
    batches = {}
    for look, (without, settings) in LOOKS.items():
        camera = flockstep.CameraConfig(width_px=320, height_px=240, hfov_deg=90.0, far_m=1000.0, **settings)
        batches[look] = sensing(plainer(world, without), places, cameras=[camera])
    times: dict[str, list[float]] = {look: [] for look in batches}
    for _ in range(RUNS):
        for look, batch in batches.items():
            times[look].append(seconds_per_sense(batch, 0.3) / batch.num_drones)
    return [
        (f"looks/raycast/{look}/ms_per_frame", 1e3 * statistics.median(times[look]), "ms", RUNS) for look in batches
    ]


def ground(rows: int, texture_px: int, path: Path, **markers: Any) -> int:
    """Write a glTF file of rolling ground, with markers if given; return the number of its triangles."""
    builder = flockstep.WorldBuilder()
    texture: dict[str, Any] = {}
    if texture_px:
        noise = np.random.default_rng(0).integers(0, 256, (texture_px // 16, texture_px // 16, 3), np.uint8)
        texture["texture"] = builder.texture("noise", np.repeat(np.repeat(noise, 16, 0), 16, 1))
    material = builder.material("ground", base_color=(0.6, 0.6, 0.5), **texture)
    along = np.arange(rows) / 12
    heights = (3 * np.sin(along)[:, None] + 3 * np.cos(0.8 * along)[None, :]).astype(np.float32)
    cell_m = 400 / rows
    builder.heightfield(heights, material, corner=(-200, -200), cell_m=cell_m, texture_m=400)
    world = builder.build()
    (world.with_markers(**markers) if markers else world).save(path)
    return 2 * (rows - 1) ** 2


LOAD = """
import json, re, sys, time, numpy as np, flockstep
def memory(what): return 1024 * int(re.search(what + r":\\s+(\\d+)", open("/proc/self/status").read())[1])
before_bytes, before = memory("VmRSS"), time.perf_counter()
world = flockstep.World.load(sys.argv[1])
loaded = time.perf_counter()
batch = flockstep.Batch([world], lidar=flockstep.LidarConfig(), cameras=[flockstep.CameraConfig()], num_threads=1)
batch.set_pose(np.float32([[0, 0, 8]]))
batch.sense()
scanned = time.perf_counter()
print(json.dumps([loaded - before, scanned - before, memory("VmRSS") - before_bytes, memory("VmHWM") - before_bytes]))
"""


def measure_loading() -> list[Measured]:
    """Load a million triangles, and two million with a texture of 8,192 x 8,192 pixels, up to the first scan."""
    found: list[Measured] = []
    for name, rows, texture_px in (("gltf1M", 708, 0), ("scan2M_8k", 1001, 8192)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "ground.glb"
            triangles = ground(rows, texture_px, path)
            runs = []
            for _ in range(3):
                program: list[str | Path] = [sys.executable, "-c", LOAD, path]
                runs.append(json.loads(subprocess.run(program, check=True, stdout=subprocess.PIPE).stdout))
            load_s, scan_s, resident, peak = np.median(runs, axis=0).tolist()
        found += [
            (f"load/{name}/seconds", load_s, "s", 3),
            (f"load/{name}/seconds_to_first_scan", scan_s, "s", 3),
            (f"load/{name}/resident_megabytes", resident / 1e6, "MB", 3),
            (f"load/{name}/peak_megabytes", peak / 1e6, "MB", 3),
        ]
        if not texture_px:
            found += [
                (f"load/{name}/bytes_per_triangle", resident / triangles, "B", 3),
                (f"load/{name}/peak_bytes_per_triangle", peak / triangles, "B", 3),
            ]
    return found
