"""A trained policy as C, as it would run beside firmware: exported, compiled, and called 500 times a second.

Needs a C compiler, `cc`. python examples/fly_header.py prints the share of throws that the C code catches. With
--through betaflight it trains a race policy in seconds. Then the C code moves the sticks and Betaflight the motors for
three laps, which needs the extra betaflight. Both print how far the C code's actions are from Python's.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import flockstep

POLICY_HZ = 500
PROGRAM = """
#include "policy.h"
void act(const float *observation, float *action) { policy_act(observation, action); }
float self_test(void) { return policy_self_test(); }
"""


class CPolicy:
    """A model as a function from observations (N, k) to actions (N, 4), which acts by its C header.

    ``difference`` is the largest difference of an action from Python's.
    """

    def __init__(self, model: Any, folder: Path) -> None:
        flockstep.export(model, folder / "policy.h")
        (folder / "policy.c").write_text(PROGRAM)
        library = folder / "policy.so"
        subprocess.run(
            ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "policy.c", "-o", library, "-lm"], cwd=folder, check=True
        )
        self._c, self._model = ctypes.CDLL(str(library)), model
        self._c.self_test.restype = ctypes.c_float
        self.difference = float(self._c.self_test())
        pointer = np.ctypeslib.ndpointer(np.float32, flags="C")
        self._c.act.argtypes = [pointer, pointer]

    def __call__(self, observations: Any) -> Any:
        """Return the actions of observations."""
        actions = np.empty((len(observations), 4), np.float32)
        for observation, action in zip(observations, actions, strict=True):
            self._c.act(observation, action)
        by_python = self._model.predict(observations, deterministic=True)[0]
        self.difference = float(np.maximum(self.difference, np.abs(actions - by_python).max()))  # also NaN
        return actions


def fly(model: Any, env: str, episodes: int, **keywords: Any) -> tuple[flockstep.Evaluation, float]:
    """Fly the header of a model; return the results, and the largest difference of its actions from Python's."""
    with tempfile.TemporaryDirectory() as folder:
        act = CPolicy(model, Path(folder))
        return flockstep.evaluate(act, env, episodes, policy_hz=POLICY_HZ, **keywords), act.difference


def catch(throws: int = 100) -> tuple[flockstep.Evaluation, float]:
    """Catch thrown drones by the bundled policy `hover`."""
    return fly(flockstep.policies.load("hover"), "flockstep/Hover-v0", throws, max_episode_steps=6 * POLICY_HZ)


def race(model: Any, flights: int = 10, laps: int = 3) -> tuple[flockstep.Evaluation, float]:
    """Race by the motors of Betaflight."""
    track = {"task": flockstep.RaceConfig(start="gate", laps=laps), "worlds": "race/figure-8", "seed": 1_000_000}
    return fly(model, "flockstep/Race-v0", flights, through="betaflight", max_episode_steps=20 * POLICY_HZ, **track)


def trained() -> flockstep.APG:
    """Train a policy for `race`. Its 50 actions a second in training serve at any rate: it has no memory."""
    preset = flockstep.presets["race_betaflight_apg"]
    return flockstep.APG("MlpPolicy", preset.make_envs(), **preset, seed=0).learn(preset.steps)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Fly a policy by its C header.")
    parser.add_argument("--through", choices=["betaflight"])
    if parser.parse_args().through is None:
        found, difference = catch()
        print(f"caught: {found.success_rate:.0%}")
    else:
        found, difference = race(trained())
        seconds = found.episode_length / POLICY_HZ
        print(f"three laps: {found.success_rate:.0%} of {found.episodes} flights, after {seconds:.1f} s")
    print(f"largest difference from Python: {difference:.1e}")
