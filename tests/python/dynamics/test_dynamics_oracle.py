"""Rotor flight, term by term, against its equations in double precision (rigid_body.py), for both integrators.

RAPTOR, a published policy for all quadrotors, is an oracle that shares nothing with them. It knows rotor speeds, masses
and lags only from its own simulator, and recognises an airframe by how it moves. Wrong signs, a wrong order of the
rotors or a wrong scale make it crash.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from foundation_policy import Raptor
from rigid_body import Body, Start, angle_between, batch_of, frame, plain, rows_of

import flockstep
from raptor import FRAMES, THROWS, ByRaptor

STEP_S = 0.01  # the rotor commands change a hundred times per second
STEPS = 100
DRONES = 6
TICKS_MS = (1, 2, 5, 10)

# Root mean squares over the drones after one second: m, degrees. Errors of the methods for a 0.75 kg quadrotor with
# random rotor speeds around hover, and the additional errors of float32.
METHOD = {
    ("midpoint", 1): (8e-6, 3e-4),
    ("midpoint", 2): (3.2e-5, 1.2e-3),
    ("midpoint", 5): (2e-4, 7e-3),
    ("midpoint", 10): (8e-4, 0.03),
    ("rk4", 1): (2e-10, 0.0),
    ("rk4", 2): (4e-9, 0.0),
    ("rk4", 5): (2e-7, 1e-5),
    ("rk4", 10): (3e-6, 2e-4),
}
FLOAT32 = (7e-6, 5e-4)

# Balanced rotors without any other symmetry.
ASKEW = {"position_m": [[0.08, -0.1, 0.01], [-0.07, 0.105, 0.02], [0.075, 0.095, 0.0], [-0.085, -0.1, 0.015]]}
LAG = {"lag_up_s": 0.033, "lag_down_s": 0.05}
ROTOR_DRAG = {"drag_n_per_radps_mps": [1e-4, 1.2e-4, 5e-5]}
LIFT = {"lift_n_per_mps2": 0.01}
LINEAR = {"linear_n_per_mps": [0.26, 0.3, 0.35]}
QUADRATIC = {"quadratic_n_per_mps2": [0.05, 0.06, 0.07]}
SPINNING = {"rotor_inertia_kgm2": 5e-6}
TERMS = {
    "thrust": {"thrust_n": [-0.3, 1e-4, 1.5e-6]},
    "lag": LAG,
    "gyroscopic": {**SPINNING, **LAG},
    "rotor drag": ROTOR_DRAG,
    "lift": LIFT,
    "linear drag": LINEAR,
    "quadratic drag": QUADRATIC,
}
ALL = {**ASKEW, **TERMS["thrust"], **LAG, **SPINNING, **ROTOR_DRAG, **LIFT, **LINEAR, **QUADRATIC}
# A term that the configuration switches off equals a frame without its numbers.
SWITCHES = {
    "rotor_lag": {"lag_up_s": 0.0, "lag_down_s": 0.0},
    "gyroscopic": {"rotor_inertia_kgm2": 0.0},
    "rotor_drag": {"drag_n_per_radps_mps": [0.0] * 3, "lift_n_per_mps2": 0.0},
    "body_drag": {"linear_n_per_mps": [0.0] * 3, "quadratic_n_per_mps2": [0.0] * 3},
}


def cases():
    """By name: the engine's frame, the reference's frame, switches."""
    every = plain(**ALL)
    table = {"nothing": (plain(), plain(), {}), "all": (every, every, {})}
    for name, changes in TERMS.items():
        table[name] = (plain(**changes), plain(**changes), {})
    for switch, nothing in SWITCHES.items():
        table[f"without {switch}"] = (every, plain(**{**ALL, **nothing}), {switch: False})
    for name in ("kingfisher", "x500"):
        table[name] = (frame(name), frame(name), {})
    return table


CASES = cases()


def commands(data, width):
    """Rotor speeds (STEPS, DRONES, 4) rad/s around hover, rounded to float32."""
    factors = np.random.default_rng(2).uniform(1 - width, 1 + width, (STEPS, DRONES, 4))
    return (flockstep.DroneModel.from_dict(data).hover_speed_radps * factors).astype(np.float32).astype(float)


@pytest.fixture(scope="module")
def flights():
    """For each case: initial states, rotor commands (STEPS, DRONES, 4), and final states (DRONES, 17)."""
    flights = {}
    for name, (data, _, _) in CASES.items():
        start = Start.random(DRONES, data, seed=1, speed_mps=2.0, rates_radps=1.0)
        if name in ("kingfisher", "x500"):
            start.quat_wxyz[:], start.velocity[:], start.rates[:] = [1, 0, 0, 0], 0, 0
            start.speed[:] = flockstep.DroneModel.from_dict(data).hover_speed_radps
        flights[name] = SimpleNamespace(start=start, told=commands(data, 0.1))
    body = Body([oracle for _, oracle, _ in CASES.values() for _ in range(DRONES)])
    starts = np.concatenate([flight.start.rows() for flight in flights.values()])
    ends = body.fly(starts, np.concatenate([flight.told for flight in flights.values()], axis=1), STEP_S)[-1]
    for flight, end in zip(flights.values(), ends.reshape(len(flights), DRONES, -1), strict=True):
        flight.end = end
    return flights


def errors(got, expected):
    """Root mean squares of position and attitude errors over the drones: m, degrees."""
    away = np.linalg.norm(got[:, :3] - expected[:, :3], axis=1)
    return tuple(np.sqrt(np.mean(error**2)) for error in (away, angle_between(got[:, 3:7], expected[:, 3:7])))


def flown(name, flight, integrator, tick_ms):
    data, _, switches = CASES[name]
    batch = batch_of(data, DRONES, 1 / STEP_S, 1000 / tick_ms, integrator=integrator, **switches)
    flight.start.place(batch)
    for told in flight.told:
        batch.fly(told)
    return rows_of(batch)


def limits(method):
    return tuple(2 * (part + float32) for part, float32 in zip(method, FLOAT32, strict=True))


@pytest.mark.parametrize("name", [name for name in CASES if name != "x500"])
@pytest.mark.parametrize("integrator", ["midpoint", "rk4"])
def test_flight_follows_the_equations(flights, name, integrator):
    for tick_ms in TICKS_MS:
        got = errors(flown(name, flights[name], integrator, tick_ms), flights[name].end)
        most = limits(METHOD[integrator, tick_ms])
        assert got[0] < most[0], f"{tick_ms} ms: {got[0]:.2g} m"
        assert got[1] < most[1], f"{tick_ms} ms: {got[1]:.2g} degrees"


def test_fast_rotors_at_a_slow_tick(flights):
    """The X500's rotors respond within 12.5 ms: the error of Runge-Kutta equals that in double precision."""
    flight = flights["x500"]
    assert errors(flown("x500", flight, "midpoint", 10), flight.end)[0] < limits((1.4e-3, 0.0))[0]
    state, body = flight.start.rows(), Body([CASES["x500"][1]] * DRONES)
    for told in flight.told:
        state = body.runge_kutta(state, told, STEP_S)
    away, turned = errors(flown("x500", flight, "rk4", 10), state)
    assert away < FLOAT32[0] and turned < FLOAT32[1]
    assert errors(state, flight.end)[0] < 1e-3


@pytest.mark.parametrize("name", TERMS)
def test_each_term_matters(flights, name):
    """Without the term, the final states would differ by far more than any Runge-Kutta limit above."""
    without = flights["lag" if name == "gyroscopic" else "nothing"].end
    away, turned = errors(flights[name].end, without)
    most_away, most_turned = limits(METHOD["rk4", 10])
    assert away > 20 * most_away or turned > 20 * most_turned


def test_orders_of_convergence():
    """Halving the tick divides midpoint's error by 4, and Runge-Kutta's by 16."""
    data = plain(**ALL)
    start = Start.random(DRONES, data, seed=1, speed_mps=2.0, rates_radps=1.0)
    told = commands(data, 0.3)[:50]
    end = Body([data] * DRONES).fly(start.rows(), told, 0.02)[-1]

    def error(integrator, tick_ms):
        batch = batch_of(data, DRONES, 50, 1000 / tick_ms, integrator=integrator)
        start.place(batch)
        for command in told:
            batch.fly(command)
        return np.array(errors(rows_of(batch), end))

    assert error("midpoint", 20) / error("midpoint", 10) == pytest.approx([4, 4], rel=0.1)
    assert error("midpoint", 10) / error("midpoint", 5) == pytest.approx([4, 4], rel=0.1)
    assert error("rk4", 20) / error("rk4", 10) == pytest.approx([16, 16], rel=0.25)


@pytest.mark.parametrize("airframe", FRAMES)
def test_raptor_holds_every_airframe(airframe):
    keywords = {"control": "rotor_speeds", "policy_hz": 100.0, "drone": airframe, "max_episode_steps": 1000}
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
