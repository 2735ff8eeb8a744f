"""Other simulators. Each function flies one, and runs in the environment that has its package."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from peers import rate
from peers.cases import DRONES, PHYSICS_HZ, POLICY_HZ, TICKS, Flown, Quadrotor


def of_crazyflow(case: Quadrotor) -> Flown:
    """Crazyflow, on JAX."""
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

    found = Flown(version("crazyflow"))
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


def of_hyperdrone(case: Quadrotor) -> Flown:
    """hyperdrone."""
    from hyperdrone import dynamics

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


def of_mujoco(case: Quadrotor) -> Flown:
    """MuJoCo: one drone at a time."""
    import mujoco

    sites = "".join(f'<site name="r{i}" pos="{" ".join(map(str, place))}"/>' for i, place in enumerate(case.position_m))
    motors = "".join(f'<motor site="r{i}" gear="0 0 1 0 0 {-case.spin[i] * case.torque_ratio_m}"/>' for i in range(4))
    inertia = " ".join(map(str, case.inertia_kgm2))
    text = f"""<mujoco><option timestep="{1 / PHYSICS_HZ}" gravity="0 0 -9.81"/><worldbody><body><freejoint/>
        <inertial pos="0 0 0" mass="{case.mass_kg}" diaginertia="{inertia}"/>{sites}</body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""
    found = Flown(version("mujoco"))
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


def of_pyflyt(case: Quadrotor) -> Flown:
    """PyFlyt, on Bullet."""
    from PyFlyt.core import Aviary
    from PyFlyt.gym_envs.quadx_envs.quadx_hover_env import QuadXHoverEnv

    found = Flown(version("PyFlyt"))
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


def of_rotorpy(case: Quadrotor) -> Flown:
    """RotorPy: its classical vehicle, and the batched one on PyTorch."""
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
    found = Flown(version("rotorpy"))
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
