"""Comparison with other quadrotor simulators: `./dev bench dynamics_peers`.

Each one is installed by pip into its own virtual environment under out/peers/, and its Python runs its function in
bench/peers/simulators.py on one pinned processor. It measures the speed in the fastest mode, and the state of the same
quadrotor after one second of given rotor speeds. The environments contain nothing of flockstep.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from peers import RUNS, Told, ask, of_each, rate, simulators
from peers.cases import DRONES, PHYSICS_HZ, POLICY_HZ, TICKS, Flown, Quadrotor
from timing import Figure, Median, median_ratio

FILE = Path(__file__).resolve()
#: Packages that pip installs for each peer. The torch version is that of .venv, which has a build without GPUs.
PEERS = {
    "mujoco": ["mujoco"],
    "crazyflow": ["crazyflow"],
    "rotorpy": ["rotorpy", "torch==2.13.0", "torchdiffeq", "roma", "opt-einsum", "stable-baselines3"],
    "pyflyt": ["PyFlyt"],
    "hyperdrone": ["hyperdrone"],
    "gym-pybullet-drones": ["gym-pybullet-drones"],
}


def of_flockstep(case: Quadrotor) -> Flown:
    found = Flown(version("flockstep"))
    hover = np.full((DRONES, 4), case.hover_radps)
    batch = flown_here(case, DRONES, quadratic=True)
    found.simulator["midpoint, 2 ms, rotor speeds"] = rate(lambda: batch.fly(hover), TICKS * DRONES)
    batch = flown_here(case, DRONES, quadratic=True, integrator="rk4", physics_hz=POLICY_HZ)
    found.simulator["rk4, 10 ms, rotor speeds"] = rate(lambda: batch.fly(hover), DRONES)
    envs = hovering(DRONES)
    action = envs.action_space.sample()
    found.environment["hover, body rates, 5 ticks"] = rate(lambda: envs.step(action), DRONES)
    return found


def hovering(num_envs: int) -> Any:
    """Return the hover environment by body rates, on one thread, without copies."""
    import flockstep

    rates: dict[str, Any] = {"control": "body_rates", "policy_hz": POLICY_HZ, "physics_hz": PHYSICS_HZ}
    task = flockstep.HoverConfig()
    envs = flockstep.DroneVectorEnv(num_envs, task=task, drone="kingfisher", num_threads=1, copy=False, **rates)
    envs.reset(seed=0)
    return envs


def flown_here(
    case: Quadrotor,
    num_drones: int = 1,
    lag: bool = True,
    linear: bool = False,
    quadratic: bool = False,
    integrator: str = "midpoint",
    physics_hz: int = PHYSICS_HZ,
) -> Any:
    """Return a batch of the case's quadrotor, at rest at the origin of an empty world."""
    import flockstep

    lag_s = case.lag_s if lag else 0.0
    data = flockstep.DroneModel.load("kingfisher").to_dict()
    data |= {"mass_kg": case.mass_kg, "inertia_kgm2": case.inertia_kgm2}
    data["rotors"] |= {
        "position_m": case.position_m,
        "spin": ["ccw" if spin > 0 else "cw" for spin in case.spin],
        "thrust_n": [0.0, 0.0, case.thrust_n],
        "torque_ratio_m": case.torque_ratio_m,
        "lag_up_s": lag_s,
        "lag_down_s": lag_s,
        "lift_n_per_mps2": 0.0,
    }
    data["drag"] = {
        "linear_n_per_mps": case.linear_drag if linear else [0.0] * 3,
        "quadratic_n_per_mps2": [case.quadratic_drag if quadratic else 0.0] * 3,
    }
    batch = flockstep.Batch(
        [flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-1e3] * 3, "max": [1e3] * 3}})],
        num_drones,
        drone=flockstep.DroneModel.from_dict(data),
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="rotor_speeds", integrator=integrator),
        clock=flockstep.ClockConfig(policy_hz=POLICY_HZ, physics_hz=physics_hz),
        num_threads=1,
    )
    batch.set_pose(np.zeros((num_drones, 3)))
    batch.set_velocity(np.zeros((num_drones, 3)), np.zeros((num_drones, 3)), np.full((num_drones, 4), case.hover_radps))
    return batch


# --------------------------------------------------------------------------------------------- in our own environment

#: Reasons why flights with the same rotor speeds end apart, by peer and the first words of its mode.
REASONS = {
    ("mujoco", "euler"): "semi-implicit Euler is a first-order method",
    ("mujoco", "rk4"): "without lag, thrust is constant within a tick, so only the integration errors remain",
    ("crazyflow", "euler"): "Euler, its default, is a first-order method",
    ("crazyflow", "rk4"): "same equations; what remains is our midpoint error and float32 rounding on both sides",
    (
        "rotorpy",
        "usual tolerance",
    ): "same equations; what remains is our midpoint error and RK45's at a relative tolerance of 1e-3",
    ("rotorpy", "tolerance 1e-10"): "same equations; what remains is our midpoint error and float32 rounding",
}


def case_of_kingfisher() -> Quadrotor:
    """Return a kingfisher and one second of commands; its rotors form a square, because some peers require one."""
    import flockstep

    drone = flockstep.DroneModel.load("kingfisher")
    data, hover = drone.to_dict(), drone.hover_speed_radps
    rotors = data["rotors"]
    return Quadrotor(
        data["mass_kg"],
        data["inertia_kgm2"],
        [[0.0875 * float(np.sign(x)), 0.0875 * float(np.sign(y)), 0.0] for x, y, _ in rotors["position_m"]],
        [1 if spin == "ccw" else -1 for spin in rotors["spin"]],
        rotors["thrust_n"][2],
        rotors["torque_ratio_m"],
        rotors["lag_up_s"],
        hover,
        data["drag"]["linear_n_per_mps"],
        data["drag"]["quadratic_n_per_mps2"][0],
        (hover * np.random.default_rng(0).uniform(0.9, 1.1, (POLICY_HZ, 4))).tolist(),
    )


def apart(case: Quadrotor, kind: str, theirs: list[float]) -> tuple[float, float]:
    """Return the difference between the ends of our flight and a peer's: m, degrees."""
    batch = flown_here(case, lag=not kind.startswith("no lag"), linear="linear" in kind, quadratic="quadratic" in kind)
    for told in case.told_radps:
        batch.fly([told])
    away = float(np.linalg.norm(batch.position[0] - theirs[:3]))
    ours, other = (np.array(q, float) / np.linalg.norm(np.array(q, float)) for q in (batch.quat_wxyz[0], theirs[3:]))
    chord = min(np.linalg.norm(ours - other), np.linalg.norm(ours + other))
    return away, float(np.degrees(4 * np.arcsin(chord / 2)))


def by_mode(runs: list[dict[str, float]]) -> dict[str, list[float]]:
    """Return the rates of all runs by mode."""
    return {mode: [run[mode] for run in runs] for mode in runs[0]}


def beside(rates: dict[str, list[float]], mode: str) -> list[float] | None:
    """Return our rates to compare with a mode: those with the same tick length, otherwise the first."""
    alike = [own for name, own in rates.items() if " 10 ms" in name and " 10 ms" in mode]
    return next(iter([*alike, *rates.values()]), None)


def measure() -> list[Figure]:
    """Return the figures of all peers, each with our own figures from the same minutes."""
    case = case_of_kingfisher()
    told = json.dumps(asdict(case))

    def measured(peer: str, python: Path) -> Iterator[Told]:
        ours: list[Flown] = []
        theirs: list[Flown] = []
        for _ in range(RUNS):
            ours.append(Flown(**ask(Path(sys.executable), FILE, "flockstep", told)))
            theirs.append(Flown(**ask(python, FILE, peer, told)))
        for kind in ("simulator", "environment"):
            own, other = (by_mode([getattr(one, kind) for one in runs]) for runs in (ours, theirs))
            for mode, values in other.items():
                about = {"version": theirs[0].version, "mode": mode}
                yield f"{peer}/{kind}/{mode}/per_second", Median(values), "1/s", RUNS, about
                if compared := beside(own, mode):
                    yield f"{peer}/{kind}/{mode}/ours_over_it", median_ratio(compared, values), "1", RUNS, about
            for mode, values in own.items():
                about = {"version": ours[0].version, "mode": mode}
                yield f"flockstep_beside_{peer}/{kind}/{mode}/per_second", Median(values), "1/s", RUNS, about
        for kind, end in theirs[0].flights.items():
            away, turned = apart(case, kind, end)
            mode = kind.split(": ")[1]
            reason = next(text for (name, word), text in REASONS.items() if name == peer and word in mode)
            about = {"version": theirs[0].version, "mode": kind, "reason": reason}
            yield f"{peer}/flight/{kind}/mm", 1e3 * away, "mm", 1, about
            yield f"{peer}/flight/{kind}/degrees", turned, "°", 1, about

    return [*of_each("dynamics_peers", PEERS, measured)]


if __name__ == "__main__":
    name, told = sys.argv[1:]
    fly = of_flockstep if name == "flockstep" else getattr(simulators, f"of_{name}")
    print("\n" + json.dumps(asdict(fly(Quadrotor(**json.loads(told))))))
