"""Comparison with other quadrotor simulators: `./dev bench dynamics_peers`.

Each one is installed by pip into its own virtual environment under out/peers/, and its Python runs this file on one
pinned processor. It measures the speed in the fastest mode, and the state of the same quadrotor after one second of
given rotor speeds. The environments contain nothing of flockstep except the numbers in `Case`; each function imports
its own packages.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from peers import RUNS, Told, ask, of_each, rate
from timing import Figure

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
DRONES = 4096
PHYSICS_HZ, POLICY_HZ = 500, 100
TICKS = PHYSICS_HZ // POLICY_HZ


@dataclass
class Case:
    """A quadrotor and its rotor speed commands, in SI units; frames and rotor order as in flockstep."""

    mass_kg: float
    inertia_kgm2: list[float]
    position_m: list[list[float]]
    spin: list[int]  # +1: counter-clockwise
    thrust_n: float  # per square of the speed
    torque_ratio_m: float
    lag_s: float
    hover_radps: float
    linear_drag: list[float]
    quadratic_drag: float
    told_radps: list[list[float]]  # (T, 4): each for 1 / POLICY_HZ


@dataclass
class Found:
    """Results of a peer: rates per second of processor time, by mode, and final states of flights, by kind."""

    version: str = ""
    simulator: dict[str, float] = field(default_factory=dict)  # drone-substeps, with the mode's step length
    environment: dict[str, float] = field(default_factory=dict)  # drone-steps
    flights: dict[str, list[float]] = field(default_factory=dict)  # x, y, z m, w, x, y, z


def of_flockstep(case: Case) -> Found:
    found = Found(version("flockstep"))
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
    case: Case,
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


def of_mujoco(case: Case) -> Found:
    import mujoco

    sites = "".join(f'<site name="r{i}" pos="{" ".join(map(str, place))}"/>' for i, place in enumerate(case.position_m))
    motors = "".join(f'<motor site="r{i}" gear="0 0 1 0 0 {-case.spin[i] * case.torque_ratio_m}"/>' for i in range(4))
    inertia = " ".join(map(str, case.inertia_kgm2))
    text = f"""<mujoco><option timestep="{1 / PHYSICS_HZ}" gravity="0 0 -9.81"/><worldbody><body><freejoint/>
        <inertial pos="0 0 0" mass="{case.mass_kg}" diaginertia="{inertia}"/>{sites}</body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""
    found = Found(version("mujoco"))
    for name in ("euler", "rk4"):
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
        data = mujoco.MjData(model)
        for told in case.told_radps:
            data.ctrl[:] = [case.thrust_n * speed**2 for speed in told]
            mujoco.mj_step(model, data, TICKS)
        found.flights[f"no lag, no drag: {name}, 2 ms"] = [*data.qpos]
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = case.mass_kg * 9.81 / 4
        call = lambda model=model, data=data: mujoco.mj_step(model, data, 1000)  # noqa: E731
        found.simulator[f"{name}, 2 ms, one drone"] = rate(call, 1000)
    return found


def of_crazyflow(case: Case) -> Found:
    import jax
    import jax.numpy as jnp
    from crazyflow.envs.reach_pos_env import ReachPosEnv
    from crazyflow.sim import Sim

    rpm = 60 / (2 * np.pi)

    def sim(worlds: int, integrator: str) -> Any:
        made = Sim(
            n_worlds=worlds, dynamics="first_principles", control="rotor_vel", integrator=integrator, freq=PHYSICS_HZ
        )
        made.reset()
        return made

    def finish(data: Any) -> None:
        jax.block_until_ready(data.states.pos)

    found = Found(version("crazyflow"))
    # Put its rotors into our order, by the signs of its mixer: roll by y, pitch by -x, yaw against the spin.
    mixing = np.array([np.sign([p[1] for p in case.position_m]), -np.sign([p[0] for p in case.position_m])])
    for integrator in ("euler", "rk4"):
        one = sim(1, integrator)
        shape = np.shape
        params = one.data.params
        drag = -np.diag(case.linear_drag)
        changes = {
            "mass": case.mass_kg,
            "J": np.diag(case.inertia_kgm2),
            "J_inv": np.diag(1 / np.array(case.inertia_kgm2)),
            "L": abs(case.position_m[0][0]),
            "prop_inertia": 0.0,
            "rpm2thrust": np.array([0, 0, case.thrust_n / rpm**2]),
            "rpm2torque": np.array([0, 0, case.thrust_n * case.torque_ratio_m / rpm**2]),
            "mixing_matrix": np.vstack([mixing, -np.array(case.spin)]),
            "drag_matrix": drag,
            "rotor_dyn_coef": np.array([1 / case.lag_s, 0, 1 / case.lag_s, 0]),
        }
        params = params.replace(
            **{
                name: jnp.broadcast_to(jnp.asarray(value, jnp.float32), shape(getattr(params, name)))
                for name, value in changes.items()
            }
        )
        height = 50.0  # m, initial height: its floor is at 0
        states = one.data.states.replace(
            pos=jnp.full((1, 1, 3), height), rotor_vel=jnp.full((1, 1, 4), case.hover_radps * rpm)
        )
        one.step_pipeline.pop("clip_rotor_vel_cmd")  # clips to the limits of its own frame
        one._step = one.build_step_fn()
        one.data = one.data.replace(params=params, states=states)
        for told in case.told_radps:
            one.rotor_vel_control(jnp.asarray(told, jnp.float32).reshape(1, 1, 4) * rpm)
            one.step(TICKS)
        end = np.asarray(one.data.states.pos[0, 0], float) - height
        x, y, z, w = np.asarray(one.data.states.quat[0, 0], float)
        found.flights[f"lag, linear drag: {integrator}, 2 ms"] = [*end, w, x, y, z]
    many = sim(DRONES, "euler")
    many.rotor_vel_control(jnp.full((DRONES, 1, 4), 15000.0))

    def step() -> None:
        many.step(TICKS)
        finish(many.data)

    found.simulator["euler, 2 ms, rotor speeds"] = rate(step, TICKS * DRONES)
    for dynamics in ("so_rpy", "first_principles"):
        envs = ReachPosEnv(num_envs=DRONES, freq=POLICY_HZ, dynamics=dynamics)
        envs.reset(seed=0)
        action = jnp.asarray(envs.action_space.sample())

        def env_step(envs: Any = envs, action: Any = action) -> None:
            jax.block_until_ready(envs.step(action)[:4])

        found.environment[f"reach a point, attitude, 5 ticks, {dynamics}"] = rate(env_step, DRONES)
    return found


def of_rotorpy(case: Case) -> Found:
    import torch
    from rotorpy.learning.quadrotor_environments import QuadrotorEnv
    from rotorpy.vehicles.crazyflie_params import quad_params as usual
    from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams, Multirotor

    torch.set_num_threads(1)
    numbers = {
        **{"mass": case.mass_kg, "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0},
        **dict(zip(("Ixx", "Iyy", "Izz"), case.inertia_kgm2, strict=True)),
        **{f"c_D{axis}": case.quadratic_drag for axis in "xyz"},
        "num_rotors": 4,
        "rotor_pos": {f"r{i}": np.array(place) for i, place in enumerate(case.position_m)},
        "rotor_directions": -np.array(case.spin),
        **{"rotor_speed_min": 0.0, "rotor_speed_max": 1e4, "k_eta": case.thrust_n},
        "k_m": case.thrust_n * case.torque_ratio_m,
        **{"k_d": 0.0, "k_z": 0.0, "k_h": 0.0, "k_flap": 0.0},
        **{"tau_m": case.lag_s, "motor_noise_std": 0.0},
    }
    found = Found(version("rotorpy"))
    rest = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0, 0, 1]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, case.hover_radps),
    }
    for name, settings in (("usual tolerance", None), ("tolerance 1e-10", {"rtol": 1e-10, "atol": 1e-10})):
        one = Multirotor(numbers, rest, integrator_kwargs=settings and {"method": "RK45", **settings})
        state = dict(rest)
        for told in case.told_radps:
            state = one.step(state, {"cmd_motor_speeds": np.array(told)}, 1 / POLICY_HZ)
        x, y, z, w = state["q"]
        found.flights[f"lag, quadratic drag: RK45, {name}"] = [*state["x"], w, x, y, z]
    hover = {"cmd_motor_speeds": np.full(4, case.hover_radps)}
    single = Multirotor(numbers, rest)
    found.simulator["RK45, 2 ms, one drone"] = rate(lambda: single.step(rest, hover, 1 / PHYSICS_HZ), 1)

    begin = {name: torch.tensor(np.tile(value, (DRONES, 1))).double() for name, value in rest.items()}
    params = BatchedMultirotorParams([numbers] * DRONES, DRONES, torch.device("cpu"))
    many = BatchedMultirotor(params, DRONES, begin, torch.device("cpu"), integrator="rk4")
    told_all = {"cmd_motor_speeds": torch.full((DRONES, 4), case.hover_radps).double()}
    found.simulator["rk4 in PyTorch, 2 ms, rotor speeds"] = rate(
        lambda: many.step(begin, told_all, 1 / PHYSICS_HZ), DRONES
    )
    # One step of 10 ms is its own default, and cheaper than five of 2 ms.
    begin["rotor_speeds"] = torch.full((DRONES, 4), 1788.53).double()
    envs = QuadrotorEnv(DRONES, begin, control_mode="cmd_ctbr", quad_params=usual, sim_rate=POLICY_HZ)
    envs.reset()
    action = np.zeros((DRONES, 4))
    found.environment["hover, body rates, one tick of 10 ms"] = rate(lambda: envs.step(action), DRONES)
    return found


def of_pyflyt(case: Case) -> Found:
    from PyFlyt.core import Aviary
    from PyFlyt.gym_envs.quadx_envs.quadx_hover_env import QuadXHoverEnv

    found = Found(version("PyFlyt"))
    many = 64
    places = np.stack([np.arange(many) * 2.0, np.zeros(many), np.full(many, 5.0)], axis=1)
    flock = Aviary(places, np.zeros((many, 3)), drone_type="quadx", drone_options={"control_hz": 120})
    flock.set_mode(0)
    flock.set_all_setpoints(np.tile([0.0, 0.0, 0.0, 0.4], (many, 1)))
    ticks = flock.physics_hz // 120  # per step, which is one controller step
    found.simulator["Bullet, 4.2 ms, body rates, 64 drones"] = rate(flock.step, round(ticks) * many)
    env = QuadXHoverEnv(agent_hz=120)  # it does not support 100 Hz
    env.reset(seed=0)
    action = np.array([0.0, 0.0, 0.0, 0.4])

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    found.environment["hover, body rates, 2 ticks of 4.2 ms"] = rate(step, 1)
    return found


def of_hyperdrone(case: Case) -> Found:
    from hyperdrone import dynamics

    found = Found(version("hyperdrone"))
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


def case_of_kingfisher() -> Case:
    """Return a kingfisher and one second of commands; its rotors form a square, because some peers require one."""
    import flockstep

    drone = flockstep.DroneModel.load("kingfisher")
    data, hover = drone.to_dict(), drone.hover_speed_radps
    rotors = data["rotors"]
    return Case(
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


def apart(case: Case, kind: str, theirs: list[float]) -> tuple[float, float]:
    """Return the difference between the ends of our flight and a peer's: m, degrees."""
    batch = flown_here(case, lag=not kind.startswith("no lag"), linear="linear" in kind, quadratic="quadratic" in kind)
    for told in case.told_radps:
        batch.fly([told])
    away = float(np.linalg.norm(batch.position[0] - theirs[:3]))
    ours, other = (np.array(q, float) / np.linalg.norm(np.array(q, float)) for q in (batch.quat_wxyz[0], theirs[3:]))
    chord = min(np.linalg.norm(ours - other), np.linalg.norm(ours + other))
    return away, float(np.degrees(4 * np.arcsin(chord / 2)))


def beside(rates: dict[str, float], mode: str) -> float | None:
    """Return our rate to compare with a mode: the one with the same tick length, otherwise the first."""
    alike = [own for name, own in rates.items() if " 10 ms" in name and " 10 ms" in mode]
    return next(iter([*alike, *rates.values()]), None)


def measure() -> list[Figure]:
    """Return the figures of all peers, each with our own figures from the same minutes."""
    case = case_of_kingfisher()
    told = json.dumps(asdict(case))

    def compared(peer: str, python: Path) -> Iterator[Told]:
        ours = Found(**ask(Path(sys.executable), FILE, "flockstep", told))
        theirs = Found(**ask(python, FILE, peer, told))
        for kind in ("simulator", "environment"):
            for mode, value in getattr(theirs, kind).items():
                about = {"version": theirs.version, "mode": mode}
                yield f"{peer}/{kind}/{mode}/per_second", value, "1/s", RUNS, about
                if own := beside(getattr(ours, kind), mode):
                    yield f"{peer}/{kind}/{mode}/ours_over_it", own / value, "1", RUNS, about
            for mode, value in getattr(ours, kind).items():
                about = {"version": ours.version, "mode": mode}
                yield f"flockstep_beside_{peer}/{kind}/{mode}/per_second", value, "1/s", RUNS, about
        for kind, end in theirs.flights.items():
            away, turned = apart(case, kind, end)
            mode = kind.split(": ")[1]
            reason = next(text for (name, word), text in REASONS.items() if name == peer and word in mode)
            about = {"version": theirs.version, "mode": kind, "reason": reason}
            yield f"{peer}/flight/{kind}/mm", 1e3 * away, "mm", 1, about
            yield f"{peer}/flight/{kind}/degrees", turned, "°", 1, about

    return [*of_each("dynamics_peers", PEERS, compared)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peer", choices=["flockstep", *PEERS])
    parser.add_argument("case", help="JSON")
    args = parser.parse_args()
    peers: dict[str, Callable[[Case], Found]] = {
        "flockstep": of_flockstep,
        "mujoco": of_mujoco,
        "crazyflow": of_crazyflow,
        "rotorpy": of_rotorpy,
        "pyflyt": of_pyflyt,
        "hyperdrone": of_hyperdrone,
    }
    if args.peer not in peers:
        sys.exit(f"{args.peer}: can be installed, but this program does not run it yet")
    print("\n" + json.dumps(asdict(peers[args.peer](Case(**json.loads(args.case))))))


if __name__ == "__main__":
    main()
