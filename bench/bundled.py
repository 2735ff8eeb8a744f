"""Speed of LiDARs and cameras in every bundled world, and the cost of loading many triangles."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from compare_rows import somewhere
from timing import Measured, Median, in_turns, timed

RUNS = 5
DRONES = 256
#: Sensors and numbers of drones, by the name of their figures.
LIDARS = {
    "fan35": flockstep.LidarConfig(channels=1, beams=35, hfov_deg=270.0, max_range_m=100.0),
    "grid16x360": flockstep.LidarConfig(channels=16, beams=360, hfov_deg=360.0, vfov_deg=30.0, max_range_m=100.0),
}
SIZES_PX = {"camera64x64": ((64, 64), DRONES), "camera640x480": ((640, 480), 4)}


def measure() -> Iterator[Measured]:
    """Time LiDAR scans and frames with depth on one thread, at random positions in free space."""
    for name in flockstep.scenes.names():
        (world,) = flockstep.scenes.load(name)
        batches = {sensor: somewhere(flockstep, [world], DRONES, lidar=lidar) for sensor, lidar in LIDARS.items()}
        for sensor, ((width, height), count) in SIZES_PX.items():
            camera = flockstep.CameraConfig(
                width_px=width, height_px=height, hfov_deg=90.0, far_m=1000.0, outputs=("rgb", "depth")
            )
            batches[sensor] = somewhere(flockstep, [world], count, cameras=[camera])
        timers = {
            sensor: timed(batch.sense, at_least_s=0.1, clock=time.perf_counter) for sensor, batch in batches.items()
        }
        yield f"worlds/{name}/triangles", float(world.check()["triangles"]), "1", 1
        for sensor, seconds in in_turns(timers, RUNS, warm_up=True).items():
            batch = batches[sensor]
            packets = batch.embree_packets
            batch.sense()
            packets = batch.embree_packets - packets
            rate = batch.num_drones / Median(seconds)
            yield f"worlds/{name}/{sensor}_per_second", rate, "1/s", RUNS
            yield f"worlds/{name}/{sensor}_embree_packets", packets / batch.num_drones, "1", 1


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


def measure_loading() -> Iterator[Measured]:
    """Load a million triangles, and two million with a texture of 8,192 x 8,192 pixels, up to the first scan."""
    for name, rows, texture_px in (("gltf1M", 708, 0), ("scan2M_8k", 1001, 8192)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "ground.glb"
            triangles = ground(rows, texture_px, path)
            runs = []
            for _ in range(3):
                program: list[str | Path] = [sys.executable, "-c", LOAD, path]
                runs.append(json.loads(subprocess.run(program, check=True, stdout=subprocess.PIPE).stdout))
            load_s, scan_s, resident, peak = map(Median, zip(*runs, strict=True))
        yield f"load/{name}/seconds", load_s, "s", 3
        yield f"load/{name}/seconds_to_first_scan", scan_s, "s", 3
        yield f"load/{name}/resident_megabytes", resident / 1e6, "MB", 3
        yield f"load/{name}/peak_megabytes", peak / 1e6, "MB", 3
        if not texture_px:
            yield f"load/{name}/bytes_per_triangle", resident / triangles, "B", 3
            yield f"load/{name}/peak_bytes_per_triangle", peak / triangles, "B", 3
