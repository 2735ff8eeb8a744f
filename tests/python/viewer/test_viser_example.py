"""``examples/viser_live.py`` with a server that only notes what it is told: viser is no dependency."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np

from flockstep import rotations


class Scene:
    """Notes the scene as viser would show it."""

    def set_up_direction(self, direction):
        self.up = direction

    def add_glb(self, name, glb, *, wxyz):
        self.world, self.world_wxyz = glb, wxyz

    def add_batched_meshes_simple(self, name, vertices, faces, batched_wxyzs, batched_positions):
        self.triangles, self.first = vertices[faces], batched_positions
        self.drones = SimpleNamespace(batched_wxyzs=batched_wxyzs, batched_positions=batched_positions)
        return self.drones


def test_it_shows_every_drone_where_it_is(example):
    scene = Scene()
    server = SimpleNamespace(scene=scene, atomic=nullcontext, initial_camera=SimpleNamespace())
    envs = example("viser_live").fly(server, num_envs=3, steps=2)
    low, high = envs.batch.world_of(0).bounds
    assert (low < server.initial_camera.position).all() and (server.initial_camera.position < high).all()
    assert scene.up == "+z"
    assert scene.world == envs.batch.world_of(0).to_glb()
    np.testing.assert_allclose(rotations.rotate(np.array(scene.world_wxyz), np.array([0, 1, 0])), [0, 0, 1], atol=1e-9)
    assert scene.triangles.shape[1:] == (3, 3)
    assert np.ptp(scene.triangles[..., 2]) < 0.5 * np.ptp(scene.triangles[..., 0])  # a drone is flat along z
    np.testing.assert_array_equal(scene.drones.batched_positions, envs.batch.position)
    np.testing.assert_array_equal(scene.drones.batched_wxyzs, envs.batch.quat_wxyz)
    assert (scene.first != envs.batch.position).any()
    envs.close()
