"""Comparison with other ray casters on the same triangles: `./dev bench mesh_peers`.

Each one is installed by pip into its own virtual environment under out/peers/, and its Python runs its function in
bench/peers/ray_casters.py on one pinned processor. It measures the rays per second of each mode, and the number of
distances that differ from ours. The environments contain nothing of flockstep except a file of triangles and rays.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from peers import HOMES, RUNS, Told, ask, of_each, rate, ray_casters
from peers.cases import FAR_M, SENSORS, Array, Cast, Mode, Rays
from timing import Figure, Median, median_ratio

FILE = Path(__file__).resolve()
#: Packages that pip installs for each peer, itself first. Open3D links to libusb, which some systems lack.
PEERS = {
    "open3d": ["open3d-cpu", "libusb-package"],
    "embreex": ["embreex"],
    "mujoco": ["mujoco"],
    "warp": ["warp-lang"],
}
WORLDS = ("office", "forest", "city")
PLACES = 24
MAX_HEIGHT_M = 2.0  # maximum height of the positions above the surface below
CHORD_ERROR_M = 0.01  # for round shapes, which are converted to triangles
ALIKE = 1e-3  # relative difference below which distances count as equal
#: Our modes that peers are compared with.
BATCH, RAYCAST = "Batch", "World.raycast"


@dataclass
class Found:
    """Results of a peer, by world and sensor, then by mode."""

    version: str
    per_second: dict[str, dict[str, float]] = field(default_factory=dict)  # rays per second of processor time
    differing: dict[str, dict[str, float]] = field(default_factory=dict)  # differing rays per million


def of_flockstep(case: Rays) -> dict[str, Mode]:
    world = world_of(case)

    def by_ray(origins: Array, directions: Array) -> Cast:
        return lambda: world.raycast(origins, directions, FAR_M)["t_hit"]

    return {
        BATCH: lambda sensor: [sensing(world, case, sensor, "auto")],
        f'{BATCH}, tracer="embree"': lambda sensor: [sensing(world, case, sensor, "embree")],
        RAYCAST: case.by_place(by_ray),
    }


def world_of(case: Rays) -> Any:
    """Return a world of only the case's triangles."""
    import flockstep

    builder = flockstep.WorldBuilder()
    builder.mesh(case.vertices, case.triangles, builder.material("grey"))
    return builder.build()


def sensor_of(name: str) -> dict[str, Any]:
    """Return the arguments that give a batch this sensor."""
    import flockstep

    if name == "camera":
        camera = flockstep.CameraConfig(
            width_px=640, height_px=480, hfov_deg=90.0, far_m=FAR_M, outputs=("depth",), depth_kind="range"
        )
        return {"cameras": [camera]}
    return {"lidar": flockstep.LidarConfig(channels=16, beams=360, hfov_deg=360.0, vfov_deg=30.0, max_range_m=FAR_M)}


def sensing(world: Any, case: Rays, sensor: str, tracer: str) -> Cast:
    """Return a function that reads a sensor at all positions."""
    import flockstep

    batch = flockstep.Batch([world], len(case.position), num_threads=1, tracer=tracer, **sensor_of(sensor))
    batch.set_pose(case.position, case.quat_wxyz)

    def sense() -> Any:
        batch.sense()
        return batch.camera().depth if sensor == "camera" else batch.lidar().ranges

    return sense


def find(peer: str, files: list[Path], compare: bool) -> Found:
    """Measure all modes of a peer once and, if requested, count the differing distances."""
    modes_of = of_flockstep if peer == "flockstep" else getattr(ray_casters, f"of_{peer}")
    found = Found(version(PEERS.get(peer, [peer])[0]))
    for file in files:
        case = Rays.load(file)
        modes = modes_of(case)
        for sensor, ours in case.distances.items():
            name = f"{file.stem}, {sensor}"
            found.per_second[name], found.differing[name] = {}, {}
            for mode, casts_of in modes.items():
                casts = casts_of(sensor)
                if compare:
                    told = np.concatenate([np.ravel(cast()) for cast in casts])
                    found.differing[name][mode] = 1e6 * float(np.mean(differ(told, ours.ravel())))
                found.per_second[name][mode] = rate(partial(trace, casts), ours.size, 1, warm_up=casts[0])
    return found


def trace(casts: list[Cast]) -> None:
    for cast in casts:
        cast()


def differ(told: Array, ours: Array) -> npt.NDArray[np.bool_]:
    """Return a mask of the rays whose distances differ. A miss is inf, beyond the maximum distance, or negative."""
    theirs = np.where((told < 0) | (told >= FAR_M), np.inf, told)
    both = np.isfinite(theirs) & np.isfinite(ours)
    apart = np.abs(np.subtract(theirs, ours, where=both, out=np.zeros(len(ours)))) > ALIKE * ours
    return np.where(both, apart, np.isfinite(theirs) != np.isfinite(ours))


# --------------------------------------------------------------------------------------------- in our own environment


def case_of(name: str) -> Rays:
    """Return the triangles of a generated world, and rays of both sensors from positions in its free space."""
    import flockstep
    from flockstep.rotations import rotate

    world = getattr(flockstep.World, name)(0)
    mesh = world.mesh(CHORD_ERROR_M)
    random = np.random.default_rng(0)
    half_yaw, half_pitch = random.uniform(-np.pi / 2, np.pi / 2, PLACES), random.uniform(-0.1, 0.1, PLACES)
    (sin_z, sin_y), (cos_z, cos_y) = np.sin([half_yaw, half_pitch]), np.cos([half_yaw, half_pitch])
    quat_wxyz = np.stack([cos_z * cos_y, -sin_z * sin_y, cos_z * sin_y, sin_z * cos_y], axis=1)
    position = world.free_places(PLACES, seed=0, max_height_m=MAX_HEIGHT_M)
    case = Rays(mesh["vertices"], mesh["triangles"], position, quat_wxyz.astype(np.float32))
    triangles = world_of(case)
    for sensor in SENSORS:
        along = rotate(case.quat_wxyz.astype(float)[:, None], pattern(sensor))
        case.directions[sensor] = (along / np.linalg.norm(along, axis=2, keepdims=True)).astype(np.float32)
        case.distances[sensor] = sensing(triangles, case, sensor, "auto")().reshape(PLACES, -1)
    return case


def pattern(sensor: str) -> Array:
    """Return the directions (R, 3) of a sensor's rays in the body frame."""
    settings = sensor_of(sensor)
    if sensor == "LiDAR":
        import flockstep

        room = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-1] * 3, "max": [1] * 3}})
        return flockstep.Batch([room], **settings, num_threads=1).lidar().directions.reshape(-1, 3).astype(float)
    (camera,) = settings["cameras"]
    u, v = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    ahead = np.ones(u.size)
    return np.stack([ahead, (camera.cx - u.ravel()) / camera.fx, (camera.cy - v.ravel()) / camera.fy], axis=1)


def rates(who: str, found: list[Found], ours: list[Found]) -> Iterator[Told]:
    """Return the figures of a program by world and sensor, with its ratios to ours of the same runs, if given."""
    for name, by_mode in found[0].per_second.items():
        for mode in by_mode:
            about = {"version": found[0].version, "mode": mode}
            values = [one.per_second[name][mode] for one in found]
            yield f"{who}/{name}/{mode}/per_second", Median(values), "1/s", RUNS, about
            yield f"{who}/{name}/{mode}/differing_in_a_million", found[0].differing[name][mode], "1", 1, about
            for what, own in (("ours_over_it", BATCH), ("raycast_over_it", RAYCAST)):
                if ours:
                    ratio = median_ratio((one.per_second[name][own] for one in ours), values)
                    yield f"{who}/{name}/{mode}/{what}", ratio, "1", RUNS, about


def measure() -> list[Figure]:
    """Return the figures of all peers, each with our own figures from the same minutes."""
    HOMES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=HOMES) as folder:
        files, figures = [Path(folder) / f"{name}.npz" for name in WORLDS], []
        for name, file in zip(WORLDS, files, strict=True):
            case = case_of(name)
            case.save(file)
            counts: dict[str, float] = {"triangles": len(case.triangles)}
            for sensor, distances in case.distances.items():
                counts |= {f"{sensor}/rays": distances.size, f"{sensor}/misses": float(np.mean(np.isinf(distances)))}
            about = {"unit": "1", "runs": 1}  # counts stay exact
            figures += [{"name": f"mesh_peers/{name}/{what}", "value": n, **about} for what, n in counts.items()]
            del case

        def compared(peer: str, python: Path) -> Iterator[Told]:
            ours: list[Found] = []
            theirs: list[Found] = []
            for run in range(RUNS):
                told = ["measure" if run else "compare", *files]
                ours.append(Found(**ask(Path(sys.executable), FILE, "flockstep", *told)))
                theirs.append(Found(**ask(python, FILE, peer, *told)))
            yield from rates(peer, theirs, ours)
            yield from rates(f"flockstep_beside_{peer}", ours, [])

        return [*figures, *of_each("mesh_peers", PEERS, compared)]


if __name__ == "__main__":
    name, compares, *paths = sys.argv[1:]
    print("\n" + json.dumps(asdict(find(name, [Path(path) for path in paths], compares == "compare"))))
