"""RAPTOR, a published policy for all quadrotors, flies ours: a check of the dynamics that shares nothing with them.

It knows rotor speeds, masses and lags only from its own simulator, and recognises an airframe by how it moves. Wrong
signs, a wrong order of the rotors or a wrong scale make it crash.
"""

import numpy as np
import pytest
from foundation_policy import Raptor

import flockstep
from raptor import FRAMES, THROWS, ByRaptor


@pytest.mark.parametrize("frame", FRAMES)
def test_raptor_holds_every_airframe(frame):
    keywords = {"control": "rotor_speeds", "policy_hz": 100.0, "drone": frame, "max_episode_steps": 1000}
    envs = flockstep.DroneVectorEnv(32, task=THROWS["gentle"], **keywords)
    observation, _ = envs.reset(seed=5)
    act = ByRaptor(envs, Raptor())
    for _ in range(500):
        observation, _, terminated, *_ = envs.step(act(observation[:, :3]))
        assert not terminated.any()
    distance = np.linalg.norm(observation[:, :3], axis=1)
    assert distance.max() < 0.5
    assert np.median(distance) < 0.15
    envs.close()
