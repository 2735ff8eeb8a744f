"""embreex: Embree, ray by ray, with and without its robustness flag."""

from __future__ import annotations

from typing import Any

from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from peers.cases import FAR_M, Array, Cast, Mode, Rays


def trace(case: Rays) -> dict[str, Mode]:
    def mode(robust: bool) -> Mode:
        scene = EmbreeScene(robust=robust)
        mesh = TriangleMesh(scene, case.vertices, case.triangles)

        def by_ray(origins: Array, directions: Array, mesh: Any = mesh) -> Cast:
            return lambda: scene.run(origins, directions, dists=FAR_M, query="DISTANCE")

        return case.by_place(by_ray)

    return {"run, distances": mode(False), "run, distances, robust": mode(True)}
