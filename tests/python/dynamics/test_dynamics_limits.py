"""Limits of flight by rotors that docs/concepts/flight-model.md and docs/reference/drones.md state with numbers."""

import numpy as np
import pytest
from conftest import world_of
from rigid_body import GRAVITY, OPEN, angle_between, batch_of, frame, rows_of

import flockstep

HALL = world_of(room={"min": [0, 0, 0], "max": [20, 20, 10]})


@pytest.mark.parametrize("on_contact", ["stop", "bounce", "terminate"])
def test_an_imu_reads_gravity_in_an_impact(on_contact):
    count, hz = 64, 500
    keywords = {"control": "rotor_thrusts", "on_contact": on_contact, "imu": flockstep.ImuConfig(rate_hz=hz)}
    batch = batch_of(frame(), count, hz, hz, worlds=[HALL], num_threads=0, **keywords)
    random = np.random.default_rng(0)
    velocity = random.normal(size=(count, 3))
    batch.set_pose(np.tile([10.0, 10.0, 5.0], (count, 1)))
    batch.set_velocity(10 * velocity / np.linalg.norm(velocity, axis=1, keepdims=True), random.normal(size=(count, 3)))
    hits, hardest = np.zeros(count, bool), 0.0
    for _ in range(2 * hz):
        before = batch.velocity.copy()
        batch.fly(np.full((count, 4), 0.5))
        batch.sense()
        now = batch.contact.hit
        hits |= now
        hardest = max(hardest, hz * np.linalg.norm(batch.velocity - before, axis=1)[now].max(initial=0.0))
        np.testing.assert_allclose(np.linalg.norm(batch.accelerometer[now], axis=1), GRAVITY, rtol=1e-5)
    assert hits.mean() > 0.5
    assert (hardest > 2000) == (on_contact != "terminate")  # m/s^2, the mean of a tick


@pytest.mark.parametrize(
    ("name", "limit", "expected_m"),
    [("crazyflie", 8, 1.17), ("kingfisher", 8, 1.60), ("t650", 8, 0.06), ("crazyflie", 16, 0), ("kingfisher", 16, 0)],
)
def test_wind_beyond_the_integral_leaves_an_error(name, limit, expected_m):
    wind = flockstep.WindConfig(mean_mps=[12, 0, 0])
    batch = batch_of(frame(name), 1, 50, control="position", max_acceleration_mps2=limit, wind=wind)
    batch.set_pose([[0, 0, 0]])
    for _ in range(60 * 50):
        batch.fly([[0, 0, 0, 0]])
    assert np.linalg.norm(batch.position[0]) == pytest.approx(expected_m, rel=0.1, abs=1e-3)
    assert np.linalg.norm(batch.velocity[0]) < 1e-3


def test_shorter_ticks_do_not_make_a_flight_more_exact():
    """From 1 kHz on, rk4 is left with the rounding of float32, which grows with the number of ticks."""
    data, count = frame("x500"), 64
    speeds = np.random.default_rng(0).uniform(0.8, 1.2, (100, count, 4))
    speeds *= flockstep.DroneModel.load("x500").hover_speed_radps
    ends = {}
    for hz in (500, 1000, 20000):
        batch = batch_of(data, count, 100, hz, integrator="rk4")
        batch.set_pose(np.zeros((count, 3)))
        for command in speeds:
            batch.fly(command)
        ends[hz] = rows_of(batch)
    near, far = (np.mean(angle_between(ends[500][:, 3:7], ends[hz][:, 3:7])) for hz in (1000, 20000))
    assert far > 5 * near


@pytest.mark.parametrize(("name", "mps"), [("hummingbird", 20 * GRAVITY), ("x500", 20 * GRAVITY), ("kingfisher", 14.1)])
def test_some_airframes_fall_without_drag(name, mps):
    batch = batch_of(frame(name), 1, 50, worlds=(OPEN,))
    batch.set_pose([[0, 0, 0]])
    for _ in range(20 * 50):
        batch.fly([[0, 0, 0, 0]])
    assert -batch.velocity[0, 2] == pytest.approx(mps, rel=0.01)


DRONES = 3000
POLICY_HZ = 10
WIND = {
    "ornstein_uhlenbeck": flockstep.WindConfig(gusts="ornstein_uhlenbeck", gust_std_mps=1.5, gust_time_s=2.0),
    "dryden": flockstep.WindConfig(gusts="dryden", mean_mps=(5, 0, 0)),
}


def in_gusts(num_drones, gusts="ornstein_uhlenbeck"):
    return batch_of(frame("x500"), num_drones, POLICY_HZ, wind=WIND[gusts])


def gusts_of(batch):
    return batch.wind.astype(float).ravel()


@pytest.mark.parametrize(("calls", "ticks"), [(50, 1), (1, 50), (1, 5000), (250, 20), (7, 7)])
def test_correlation_falls_with_time(calls, ticks):
    """A gust lasts one step, so the time counts between the beginnings of two steps."""
    batch = in_gusts(DRONES)
    command = np.full((DRONES, 4), 400.0)
    batch.fly(command, ticks=1)
    first = gusts_of(batch)
    for _ in range(calls):
        batch.fly(command, ticks=ticks)
    expected = np.exp(-(calls * ticks // 50) / POLICY_HZ / 2.0)
    assert np.corrcoef(first, gusts_of(batch))[0, 1] == pytest.approx(expected, abs=5 / np.sqrt(3 * DRONES))


@pytest.mark.parametrize("gusts", WIND)
def test_calls_of_any_length_have_the_same_gusts(gusts):
    command = np.full((2, 4), 400.0)
    winds = []
    for ticks in (1, 7, 50, 350):
        batch = in_gusts(2, gusts)
        for _ in range(350 // ticks):
            batch.fly(command, ticks=ticks)
        winds.append(batch.wind.copy())
    np.testing.assert_array_equal(winds, [winds[0]] * 4)


def test_an_env_has_the_same_gusts_beside_envs_at_other_ticks():
    """The same bits, including positions, even if the other envs are in the middle of a step."""
    command = np.full((3, 4), 500.0)
    alone, beside = in_gusts(1), in_gusts(3)
    beside.fly(command, ticks=13, mask=[False, True, False])
    beside.fly(command, ticks=49, mask=[False, False, True])
    for ticks in (3, 50, 120, 1, 1):
        alone.fly(command[:1], ticks=ticks)
        beside.fly(command, ticks=ticks)
    for name in ("position", "quat_wxyz", "velocity", "wind"):
        np.testing.assert_array_equal(getattr(alone, name)[0], getattr(beside, name)[0])
    assert beside.tick.tolist() == [175, 188, 224]
