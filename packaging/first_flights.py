"""Test flights with an installed wheel for `./dev wheel --prove`: LiDAR, cameras, a training, a page, headers.

usage: first_flights.py with-opengl | without-opengl | without-gl

without-opengl: the machine has no OpenGL. without-gl: the wheel was built without the camera backend gl.
"""

import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

import flockstep


def fly_lidar() -> None:
    """Fly 64 drones through a bundled world and check their LiDAR observations."""
    envs = flockstep.DroneVectorEnv(64, worlds="train")
    observation, _ = envs.reset(seed=0)
    assert observation.shape == (64, 38), observation.shape
    for _ in range(100):
        observation, *_ = envs.step(envs.action_space.sample())
    assert np.isfinite(observation).all()


def see(backend: str) -> None:
    """Render a frame of every camera."""
    world = flockstep.World.load("playground/camera-train-1")
    batch = flockstep.Batch([world], 8, cameras=[flockstep.CameraConfig()], camera_backend=backend)
    batch.sense()
    assert batch.camera("front").rgb.std() > 0, f"{backend} sees nothing"


def learn() -> None:
    """Fly a bundled policy, and train a moment by the command, in an empty folder."""
    policy = flockstep.policies.load("lidar")
    assert flockstep.evaluate(policy, episodes=7, worlds=["train", "validation"]).success_rate == 1
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "flockstep", "train", "hover", "--steps", "16384", "--flights", "4"]
        subprocess.run(command, cwd=folder, check=True)
        assert (Path(folder) / "hover.zip").is_file()


def replay() -> None:
    """Write a page that replays a flight."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "flight.html"
        flockstep.record(page, steps=5, worlds="playground/train-1", quiet=True)
        assert page.read_text(encoding="utf-8").count('<script type="application/gzip">') == 1


def main() -> None:
    """Fly, and compare the OpenGL warnings with the machine's abilities."""
    reasons = {"with-opengl": (), "without-opengl": ("libegl1", "libgl1"), "without-gl": ("has no backend gl",)}
    expected = reasons[sys.argv[1]]
    fly_lidar()
    see("raycast")
    learn()
    if sys.argv[1] != "without-gl":  # those wheels are built without Node.js
        replay()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        see("gl")
    said = " ".join(str(warning.message) for warning in caught)
    assert bool(said) == bool(expected), said
    assert all(reason in said for reason in expected), said
    print(f"lidar and raycast fly; gl {f'says: {said}' if said else 'flies'}")
    assert (flockstep.include_dir() / "flockstep" / "task.hpp").is_file()
    assert (flockstep.cmake_dir() / "flockstepConfig.cmake").is_file()


if __name__ == "__main__":
    main()
