"""Ctrl-C ends long work soon and leaves nothing half done."""

import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import ROOT

TRAINING = """
import runpy, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("training.train_ppo", run_name="__main__", alter_sys=True)
"""

# Generous limit; on a quiet machine an interrupt ends each work within a second.
PATIENCE_S = 10.0
INTERRUPT_AFTER_S = 0.4

PREPARE = """
import signal
import sys
import numpy as np
import flockstep

signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell takes from jobs in its background

def work(call):
    print("begun", flush=True)
    try:
        call()
    except KeyboardInterrupt:
        print("interrupted", flush=True)
    else:
        print("finished", flush=True)

room = flockstep.World.load("playground/train-1")
"""

# Each takes at least five times INTERRUPT_AFTER_S on a fast machine.
WORK = {
    "load a mesh": """
with open(sys.argv[1] + "/large.obj", "w") as file:
    file.write("".join(f"v {i} {i**2 % 1009} {i**3 % 1013}\\n" for i in range(1000)))
    faces = "".join(f"f {i} {i + 1} {i + 2}\\n" for i in range(1, 998))
    for _ in range(10_000):
        file.write(faces)
work(lambda: flockstep.World.load(sys.argv[1] + "/large.obj"))
""",
    "load a scene": """
with open(sys.argv[1] + "/large.json", "w") as file:
    spheres = ",".join(f'{{"center": [{i}, 0, 0], "radius": 0.1}}' for i in range(1000))
    file.write('{"flockstep_scene": 1, "spheres": [' + ",".join([spheres] * 2000) + "]}")
work(lambda: flockstep.World.load(sys.argv[1] + "/large.json"))
""",
    "step": """
camera = flockstep.CameraConfig(width_px=2048, height_px=2048, samples_per_pixel=16)
batch = flockstep.Batch([room], 16, cameras=[camera], task=flockstep.NavigationConfig(), lidar=flockstep.LidarConfig())
batch.seed(np.arange(16))
work(lambda: batch.reset(np.arange(16)))
try:
    batch.step(np.zeros(16, int))
except RuntimeError as error:
    print(error)
""",
    "fly": """
dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity", on_contact="stop")
batch = flockstep.Batch([room], 2048, block_size=2048, dynamics=dynamics)
batch.set_pose(np.tile([0.5, 0.5, 0.5], (2048, 1)))
command = np.tile(np.float32([-3, -3, -3, 0]), (2048, 1))  # into a corner
work(lambda: batch.fly(command, ticks=1_000_000))
batch.fly(command)
assert np.isfinite(batch.position).all() and not batch.contact.inside.any()
""",
    "raycast": """
rays = np.tile(np.float32([[1, 0.1, 0]]), (16_000_000, 1))
work(lambda: room.raycast(rays, rays, 100.0))
""",
    "distance": """
work(lambda: room.distance(0.02))
""",
}


@pytest.mark.parametrize("name", WORK)
def test_ctrl_c_ends(name, tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", PREPARE + WORK[name], str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as child:
        assert child.stdout.readline() == "begun\n"
        time.sleep(INTERRUPT_AFTER_S)
        child.send_signal(signal.SIGINT)
        asked = time.monotonic()
        assert child.stdout.readline() == "interrupted\n"
        assert time.monotonic() - asked < PATIENCE_S
        rest = child.stdout.read()
        assert child.wait() == 0, rest
        if name == "step":
            assert "interrupted the last step() or reset() of this Batch" in rest


def test_ctrl_c_ends_training(tmp_path):
    arguments = ["--out", str(tmp_path), "--evaluate-every", "1000", "--evaluation-flights", "2", "--generated", "2"]
    with subprocess.Popen(
        [sys.executable, "-c", TRAINING, *arguments, "--num-envs", "64", "--no-progress"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as child:
        lines = iter(child.stdout.readline, "")
        assert any("steps: success in" in line for line in lines)
        child.send_signal(signal.SIGINT)
        asked = time.monotonic()
        rest = child.stdout.read()
        assert child.wait() == 130, rest
        assert time.monotonic() - asked < PATIENCE_S
        assert "Traceback" not in rest
        assert "Interrupted" in rest
        assert (tmp_path / "policy.zip").exists()
        assert not (tmp_path / "written.zip").exists()
