"""A trained policy as C, as it would run beside firmware: exported, compiled, and called 500 times a second.

Needs a C compiler, `cc`. python examples/fly_header.py prints the share of throws that the C code catches.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import flockstep

PROGRAM = """
#include "hover.h"
void act(const float *observation, float *action) { hover_act(observation, action); }
float self_test(void) { return hover_self_test(); }
"""


def compiled(folder: Path) -> Callable[[Any], Any]:
    """Return the bundled policy `hover` as a function of observations (N, 16), which acts by the C header."""
    envs = flockstep.DroneVectorEnv(1, task=flockstep.HoverConfig())  # only for the comment in the header
    flockstep.export(flockstep.policies.load("hover"), folder / "hover.h", env=envs)
    (folder / "hover.c").write_text(PROGRAM)
    library = folder / "hover.so"
    subprocess.run(
        ["cc", "-std=c99", "-O2", "-shared", "-fPIC", "hover.c", "-o", library, "-lm"], cwd=folder, check=True
    )
    c = ctypes.CDLL(str(library))
    c.self_test.restype = ctypes.c_float
    assert c.self_test() < 1e-6
    pointer = np.ctypeslib.ndpointer(np.float32, flags="C")
    c.act.argtypes = [pointer, pointer]

    def act(observations: Any) -> Any:
        actions = np.empty((len(observations), 4), np.float32)
        for observation, action in zip(observations, actions, strict=True):
            c.act(observation, action)
        return actions

    return act


def main(throws: int = 100) -> float:
    """Fly the header; return the share of throws that it catches."""
    with tempfile.TemporaryDirectory() as folder:
        act = compiled(Path(folder))
        found = flockstep.evaluate(act, "flockstep/Hover-v0", throws, policy_hz=500, max_episode_steps=3000)
    return found.success_rate


if __name__ == "__main__":
    print(f"caught: {main():.0%}")
