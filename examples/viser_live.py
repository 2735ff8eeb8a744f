"""Watch many drones in viser while a program steps them: python examples/viser_live.py, then open the printed address.

Needs viser, which pip installs, best into an environment without trainers: it asks for older packages than theirs.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import flockstep


def show(server: Any, envs: flockstep.DroneVectorEnv) -> Any:
    """Show the world and the drones; return the drones, whose poses can be set."""
    server.scene.set_up_direction("+z")
    world = envs.batch.world_of(0)
    low, high = np.asarray(world.bounds)
    server.initial_camera.position = low + [0.1, 0.1, 0.85] * (high - low)  # in a corner, below the ceiling
    server.initial_camera.look_at = low + [0.5, 0.5, 0.2] * (high - low)
    server.scene.add_glb("/world", world.to_glb(), wxyz=(0.5**0.5, 0.5**0.5, 0, 0))  # in glTF files y points up
    mesh = flockstep.DroneMesh.quadrotor(envs.batch.drone)
    wxyzs, positions = envs.batch.quat_wxyz.copy(), envs.batch.position.copy()
    return server.scene.add_batched_meshes_simple("/drones", mesh.vertices, mesh.triangles, wxyzs, positions)


def fly(server: Any, num_envs: int = 64, steps: int = 10_000) -> flockstep.DroneVectorEnv:
    """Fly the bundled LiDAR policy at the speed of flight, from random starts; return the envs."""
    envs = flockstep.DroneVectorEnv(num_envs, worlds="playground/train-2", random_start=True)
    policy = flockstep.policies.load("lidar")
    observation, _ = envs.reset(seed=0)
    drones = show(server, envs)
    due = time.monotonic()
    for _ in range(steps):
        observation = envs.step(policy.predict(observation, deterministic=True)[0])[0]
        with server.atomic():  # a browser sees all drones of one moment
            drones.batched_positions = envs.batch.position.copy()
            drones.batched_wxyzs = envs.batch.quat_wxyz.copy()
        due += envs.recipe.episode.frame_skip / envs.batch.clock.policy_hz
        time.sleep(max(due - time.monotonic(), 0))
    return envs


def main() -> None:
    """Serve, and fly until Ctrl-C."""
    import viser

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=8080)
    parser.add_argument("--num-envs", type=int, default=64)
    arguments = parser.parse_args()
    fly(viser.ViserServer(port=arguments.port), arguments.num_envs)


if __name__ == "__main__":
    main()
