"""Other ray casters. Each function returns the modes of one, and runs in the environment that has its package."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from typing import Any

import numpy as np

from peers.cases import FAR_M, Array, Cast, Mode, Rays


def of_embreex(case: Rays) -> dict[str, Mode]:
    """embreex: Embree, ray by ray, with and without its robustness flag."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    def mode(robust: bool) -> Mode:
        scene = EmbreeScene(robust=robust)
        mesh = TriangleMesh(scene, case.vertices, case.triangles)

        def by_ray(origins: Array, directions: Array, mesh: Any = mesh) -> Cast:
            return lambda: scene.run(origins, directions, dists=FAR_M, query="DISTANCE")

        return case.by_place(by_ray)

    return {"run, distances": mode(False), "run, distances, robust": mode(True)}


def of_mujoco(case: Rays) -> dict[str, Mode]:
    """MuJoCo: rays through all triangles as one geom."""
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


def of_open3d(case: Rays) -> dict[str, Mode]:
    """Open3D: Embree, ray by ray."""
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()))  # must be loaded before Open3D
    import open3d

    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(case.vertices), open3d.core.Tensor(case.triangles.astype(np.uint32)))

    def by_ray(origins: Array, directions: Array) -> Cast:
        rays = open3d.core.Tensor(np.concatenate([origins, directions], axis=1))
        return lambda: scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()

    return {"cast_rays": case.by_place(by_ray)}


def of_warp(case: Rays) -> dict[str, Mode]:
    """Warp, on its CPU device."""
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
