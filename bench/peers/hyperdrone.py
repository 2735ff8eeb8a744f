"""hyperdrone."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from hyperdrone import dynamics

from peers import rate
from peers.cases import DRONES, Flown, Quadrotor


def fly(case: Quadrotor) -> Flown:
    found = Flown(version("hyperdrone"))
    sim = dynamics.Sim(DRONES, seed=0, device="cpu")
    sim.reset()
    action = np.zeros((DRONES, 4), np.float32)
    length = f"{1000 * sim.dt:g} ms"
    found.simulator[f"rk4, {length}, motor commands"] = rate(lambda: sim.step(action), DRONES)

    def step() -> None:
        sim.step(action)
        sim.observe()

    found.environment[f"simulator with observation, one tick of {length}"] = rate(step, DRONES)
    return found
