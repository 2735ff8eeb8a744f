"""Plots of paths in any world, also one made of triangles or without markers."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import flockstep
from flockstep.pictures.relief import SOLID

pytest.importorskip("stable_baselines3")


def test_a_mesh_and_a_path_that_leaves_it_are_drawn(tmp_path):
    from training.evaluate import Flight
    from training.plot_paths import draw_path, plot_flight

    wall = [[3, -2, 0], [3, 2, 0], [3, 2, 2], [3, -2, 2]]
    floor = [[0, -3, 0], [6, -3, 0], [6, 3, 0], [0, 3, 0]]
    meshes = [{"vertices": corners, "triangles": [[0, 1, 2], [0, 2, 3]]} for corners in (wall, floor)]
    scene = {"flockstep_scene": 1, "name": "wall", "meshes": meshes, "markers": {"goal": [5, 0, 1]}}
    world = flockstep.World.from_dict(scene)
    trail = np.float32([[1, 0, 1], [1, 2.5, 1], [8, 2.5, 1]])
    flight = Flight("wall", "time", 2, 0.0, 9.5, None, trail)
    figure, axes = plt.subplots()
    for view, corners, dark in (("top", (0, 8, -3, 3), 3), ("side", (0, 8, 0, 2), None)):
        axes.clear()
        draw_path(axes, world, view, flight, ("start",))
        (image,), circles = axes.get_images(), axes.patches
        left, right, bottom, top = image.get_extent()
        assert left < corners[0] < corners[1] < right
        assert bottom < corners[2] < corners[3] < top
        assert right - left == pytest.approx(8 * 1.03)
        assert not circles  # the world has no start
        columns = np.flatnonzero((np.asarray(image.get_array()) == SOLID).all(axis=-1).any(axis=0))
        if dark is not None:  # from above, the cut follows the wall
            np.testing.assert_allclose(left + (columns + 0.5) * (right - left) / 900, dark, atol=0.02)
    draw_path(axes, world, "top", flight, ("goal",))
    assert [circle.center for circle in axes.patches] == [(5, 0)]
    plt.close(figure)
    plot_flight(world, flight, tmp_path / "path.png")
    assert (tmp_path / "path.png").stat().st_size > 1000
