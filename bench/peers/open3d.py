"""Open3D: Embree, ray by ray."""

from __future__ import annotations

import ctypes

import libusb_package
import numpy as np

from peers.cases import Array, Cast, Mode, Rays

ctypes.CDLL(str(libusb_package.get_library_path()))  # must be loaded before Open3D
import open3d  # noqa: E402


def trace(case: Rays) -> dict[str, Mode]:
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(open3d.core.Tensor(case.vertices), open3d.core.Tensor(case.triangles.astype(np.uint32)))

    def by_ray(origins: Array, directions: Array) -> Cast:
        rays = open3d.core.Tensor(np.concatenate([origins, directions], axis=1))
        return lambda: scene.cast_rays(rays, nthreads=1)["t_hit"].numpy()

    return {"cast_rays": case.by_place(by_ray)}
