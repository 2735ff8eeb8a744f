"""Warp, on its CPU device."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import warp as wp

from peers.cases import FAR_M, Array, Cast, Mode, Rays


def trace(case: Rays) -> dict[str, Mode]:
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
