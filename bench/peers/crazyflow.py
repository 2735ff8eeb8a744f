"""Crazyflow, on JAX."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from crazyflow.envs.reach_pos_env import ReachPosEnv
from crazyflow.sim import Sim

from peers import rate
from peers.cases import DRONES, PHYSICS_HZ, POLICY_HZ, TICKS, Flown, Quadrotor


def fly(case: Quadrotor) -> Flown:
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
