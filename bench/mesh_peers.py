"""Comparison with other ray casters on the same triangles: `./dev bench mesh_peers`.

Each one is installed by pip into its own virtual environment under out/peers/, and its Python runs this file on one
pinned processor. It measures the rays per second of each mode, and the number of distances that differ from ours. The
environments contain nothing of flockstep except a file of triangles and rays; each function imports its own packages.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from peers import HOMES, RUNS, Told, ask, of_each, rate
from timing import Figure, median_ratio

FILE = Path(__file__).resolve()
#: Packages that pip installs for each peer. Open3D links to libusb, which some systems lack.
PEERS = {
    "open3d": ["open3d-cpu", "libusb-package"],
    "embreex": ["embreex"],
    "mujoco": ["mujoco"],
    "warp": ["warp-lang"],
}
WORLDS = ("office", "forest", "city")
SENSORS = ("camera", "LiDAR")
PLACES = 24
MAX_HEIGHT_M = 2.0  # maximum height of the positions above the surface below
CHORD_ERROR_M = 0.01  # for round shapes, which are converted to triangles
FAR_M = 1000.0  # maximum distance of a hit
ALIKE = 1e-3  # relative difference below which distances count as equal
#: Arrays of a case: one for all, and one for each sensor.
ALONE, BY_SENSOR = ("vertices", "triangles", "position", "quat_wxyz"), ("directions", "distances")
#: Our modes that peers are compared with.
BATCH, RAYCAST = "Batch", "World.raycast"

Array = npt.NDArray[Any]
Cast = Callable[[], Any]  # traces rays and returns their distances
Mode = Callable[[str], list[Cast]]  # by sensor; together the casts trace all of its rays


@dataclass
class Case:
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
    def load(path: Path) -> Case:
        with np.load(path) as file:
            by_sensor = [{sensor: file[f"{name}_{sensor}"] for sensor in SENSORS} for name in BY_SENSOR]
            return Case(*(file[name] for name in ALONE), *by_sensor)

    def by_place(self, prepare: Callable[[Array, Array], Cast]) -> Mode:
        """Return a mode that traces one position's rays per call; `prepare` gets origins and directions (R, 3)."""

        def casts(sensor: str) -> list[Cast]:
            along = self.directions[sensor]
            return [
                prepare(np.tile(place, (along.shape[1], 1)), directions)
                for place, directions in zip(self.position, along, strict=True)
            ]

        return casts


@dataclass
class Found:
    """Results of a peer, by world and sensor, then by mode."""

    version: str
    per_second: dict[str, dict[str, float]] = field(default_factory=dict)  # rays per second of processor time
    differing: dict[str, dict[str, float]] = field(default_factory=dict)  # differing rays per million


def of_flockstep(case: Case) -> dict[str, Mode]:
    world = world_of(case)

    def by_ray(origins: Array, directions: Array) -> Cast:
        return lambda: world.raycast(origins, directions, FAR_M)["t_hit"]

    return {
        BATCH: lambda sensor: [sensing(world, case, sensor, "auto")],
        f'{BATCH}, tracer="embree"': lambda sensor: [sensing(world, case, sensor, "embree")],
        RAYCAST: case.by_place(by_ray),
    }


def world_of(case: Case) -> Any:
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


def sensing(world: Any, case: Case, sensor: str, tracer: str) -> Cast:
    """Return a function that reads a sensor at all positions."""
    import flockstep

    batch = flockstep.Batch([world], len(case.position), num_threads=1, tracer=tracer, **sensor_of(sensor))
    batch.set_pose(case.position, case.quat_wxyz)

    def sense() -> Any:
        batch.sense()
        return batch.camera().depth if sensor == "camera" else batch.lidar().ranges

    return sense


def of_open3d(case: Case) -> dict[str, Mode]:
    import ctypes

    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()))  # must be loaded before Open3D
    import open3d

    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(case.vertices), open3d.core.Tensor(case.triangles.astype(np.uint32)))

    def by_ray(origins: Array, directions: Array) -> Cast:
        rays = open3d.core.Tensor(np.concatenate([origins, directions], axis=1))
        return lambda: scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()

    return {"cast_rays": case.by_place(by_ray)}


def of_embreex(case: Case) -> dict[str, Mode]:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    def mode(robust: bool) -> Mode:
        scene = EmbreeScene(robust=robust)
        mesh = TriangleMesh(scene, case.vertices, case.triangles)

        def by_ray(origins: Array, directions: Array, mesh: Any = mesh) -> Cast:
            return lambda: scene.run(origins, directions, dists=FAR_M, query="DISTANCE")

        return case.by_place(by_ray)

    return {"run, distances": mode(False), "run, distances, robust": mode(True)}


def of_mujoco(case: Case) -> dict[str, Mode]:
    import mujoco

    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="mesh", uservert=case.vertices.ravel().astype(float), userface=case.triangles.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the mesh is not closed
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh", contype=0, conaffinity=0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def by_ray(origins: Array, directions: Array) -> Cast:
        count = len(directions)
        origin, along = origins[0].astype(float), directions.ravel().astype(float)
        geometry, distances = np.empty(count, np.int32), np.empty(count)

        def cast() -> Array:
            mujoco.mj_multiRay(model, data, origin, along, None, True, -1, geometry, distances, None, count, FAR_M)
            return distances

        return cast

    return {"mj_multiRay": case.by_place(by_ray)}


def of_warp(case: Case) -> dict[str, Mode]:
    import warp as wp

    wp.config.kernel_cache_dir = str(Path(sys.prefix) / "kernels")
    wp.init()

    def nearest(
        mesh: wp.uint64,
        origins: wp.array[wp.vec3],
        directions: wp.array[wp.vec3],
        far: float,
        distances: wp.array[float],
    ) -> None:
        ray = wp.tid()
        hit = wp.mesh_query_ray(mesh, origins[ray], directions[ray], far)
        distances[ray] = wp.where(hit.result, hit.t, wp.inf)

    kernel = wp.kernel(nearest)
    vertices = wp.array(case.vertices, dtype=wp.vec3, device="cpu")
    mesh = wp.Mesh(vertices, wp.array(case.triangles.ravel(), dtype=wp.int32, device="cpu"), bvh_constructor="sah")

    def by_ray(origins: Array, directions: Array) -> Cast:
        arrays = [wp.array(values, dtype=wp.vec3, device="cpu") for values in (origins, directions)]
        distances = wp.empty(len(directions), dtype=float, device="cpu")

        def cast() -> Any:
            wp.launch(kernel, dim=len(directions), inputs=[mesh.id, *arrays, FAR_M, distances], device="cpu")
            return distances.numpy()

        return cast

    return {"mesh_query_ray, CPU device": case.by_place(by_ray)}


#: For each name: the distribution with its version, and the function that makes its modes.
OF: dict[str, tuple[str, Callable[[Case], dict[str, Mode]]]] = {
    "flockstep": ("flockstep", of_flockstep),
    "open3d": ("open3d-cpu", of_open3d),
    "embreex": ("embreex", of_embreex),
    "mujoco": ("mujoco", of_mujoco),
    "warp": ("warp-lang", of_warp),
}


def find(peer: str, files: list[Path], compare: bool) -> Found:
    """Measure all modes of a peer once and, if requested, count the differing distances."""
    distribution, modes_of = OF[peer]
    found = Found(version(distribution))
    for file in files:
        case = Case.load(file)
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


def case_of(name: str) -> Case:
    """Return the triangles of a generated world, and rays of both sensors from positions in its free space."""
    import flockstep

    world = getattr(flockstep.World, name)(0)
    mesh = world.mesh(CHORD_ERROR_M)
    random = np.random.default_rng(0)
    half_yaw, half_pitch = random.uniform(-np.pi / 2, np.pi / 2, PLACES), random.uniform(-0.1, 0.1, PLACES)
    (sin_z, sin_y), (cos_z, cos_y) = np.sin([half_yaw, half_pitch]), np.cos([half_yaw, half_pitch])
    quat_wxyz = np.stack([cos_z * cos_y, -sin_z * sin_y, cos_z * sin_y, sin_z * cos_y], axis=1)
    position = world.free_places(PLACES, seed=0, max_height_m=MAX_HEIGHT_M)
    case = Case(mesh["vertices"], mesh["triangles"], position, quat_wxyz.astype(np.float32))
    triangles = world_of(case)
    for sensor in SENSORS:
        along = turned(case.quat_wxyz, pattern(sensor))
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


def turned(quat_wxyz: Array, vectors: Array) -> Array:
    """Rotate vectors (R, 3) by each of the quaternions (N, 4): (N, R, 3)."""
    quat = quat_wxyz.astype(float) / np.linalg.norm(quat_wxyz.astype(float), axis=1, keepdims=True)
    w, axis = quat[:, None, :1], quat[:, None, 1:]
    twice = 2 * np.cross(axis, vectors[None])
    return np.asarray(vectors + w * twice + np.cross(axis, twice))


def rates(who: str, found: list[Found], ours: list[Found]) -> Iterator[Told]:
    """Return the figures of a program by world and sensor, with its ratios to ours of the same runs, if given."""
    for name, by_mode in found[0].per_second.items():
        for mode in by_mode:
            about = {"version": found[0].version, "mode": mode}
            values = [one.per_second[name][mode] for one in found]
            yield f"{who}/{name}/{mode}/per_second", statistics.median(values), "1/s", RUNS, about
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
                told = [*files, *(["--compare"] if run == 0 else [])]
                ours.append(Found(**ask(Path(sys.executable), FILE, "flockstep", *told)))
                theirs.append(Found(**ask(python, FILE, peer, *told)))
            yield from rates(peer, theirs, ours)
            yield from rates(f"flockstep_beside_{peer}", ours, [])

        return [*figures, *of_each("mesh_peers", PEERS, compared)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peer", choices=list(OF))
    parser.add_argument("files", nargs="+", type=Path, help="cases; the name of a file is that of its world")
    parser.add_argument("--compare", action="store_true", help="also report how many distances differ")
    args = parser.parse_args()
    print("\n" + json.dumps(asdict(find(args.peer, args.files, args.compare))))


if __name__ == "__main__":
    main()
