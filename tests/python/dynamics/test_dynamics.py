"""Rotor flight against closed forms and conservation laws, its signs, and scaled drones."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from rigid_body import (
    FRAMES,
    GRAVITY,
    UP,
    Body,
    Start,
    angle_between,
    batch_of,
    fly_for,
    frame,
    plain,
    to_body,
    to_world,
)
from scipy.spatial.transform import Rotation

import flockstep

NO_THRUST = {"min_speed_radps": 0.0}  # stopped rotors give no thrust
STILL = np.zeros(4)
INTEGRATORS = ["midpoint", "rk4"]
MASS, INERTIA = 0.75, np.array([0.0025, 0.0021, 0.0043])  # of the kingfisher

SHORT_LAGS = [("midpoint", lag) for lag in (0.0, 1e-3, 3e-3, 0.01)]
SHORT_LAGS += [("rk4", 0.0), ("rk4", 0.01), ("automatic", 1e-3), ("automatic", 3e-3)]

every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)
every_frame = pytest.mark.parametrize("name", FRAMES)


def hover_speed(data):
    return flockstep.DroneModel.from_dict(data).hover_speed_radps


def hovering(data, factors=1.0):
    """Rotor speeds (4,) rad/s that carry the weight, times some factors."""
    return hover_speed(data) * np.broadcast_to(factors, 4)


def at_rest(data, speed=STILL, **arguments):
    """One drone whose rotors have this speed (4,)."""
    batch = batch_of(data, **arguments)
    batch.set_velocity(None, None, [speed])
    return batch


class TestClosedForms:
    @every_integrator
    @pytest.mark.parametrize("drag", ["linear_n_per_mps", "quadratic_n_per_mps2"])
    def test_free_fall_with_drag(self, integrator, drag):
        k, t = 0.3, 2.0
        batch = at_rest(plain(**NO_THRUST, **{drag: [0.1, 0.2, k]}), integrator=integrator)
        fly_for(batch, STILL, t)
        final = np.sqrt(MASS * GRAVITY / k)
        speed = {
            "linear_n_per_mps": MASS * GRAVITY / k * (1 - np.exp(-k * t / MASS)),
            "quadratic_n_per_mps2": final * np.tanh(GRAVITY * t / final),
        }[drag]
        np.testing.assert_allclose(batch.velocity[0], [0, 0, -speed], rtol=2e-6)

    @every_integrator
    def test_free_fall(self, integrator):
        batch = at_rest(plain(**NO_THRUST), integrator=integrator, physics_hz=100)
        batch.set_velocity([[1, -2, 3]])
        fly_for(batch, STILL, 1)
        np.testing.assert_allclose(batch.velocity[0], [1, -2, 3 - GRAVITY], rtol=2e-6)
        np.testing.assert_allclose(batch.position[0], [1, -2, 3 - GRAVITY / 2], rtol=2e-6)
        np.testing.assert_allclose(batch.acceleration[0], [0, 0, -GRAVITY], atol=2e-4)

    @pytest.mark.parametrize(("integrator", "physics_hz"), [("midpoint", 50), ("midpoint", 500), ("rk4", 1000)])
    def test_constant_angular_velocity(self, integrator, physics_hz):
        """Midpoint rotates exactly for any tick, here by up to 0.75 rad."""
        batch = at_rest(
            plain(**NO_THRUST, inertia_kgm2=[0.003] * 3), integrator=integrator, policy_hz=50, physics_hz=physics_hz
        )
        turn = np.array([30.0, -20.0, 10.0])
        batch.set_velocity(None, [turn])
        fly_for(batch, STILL, 2, policy_hz=50)
        np.testing.assert_array_equal(batch.angular_velocity[0], turn)
        assert angle_between(batch.quat_wxyz, Rotation.from_rotvec([2 * turn]).as_quat(scalar_first=True)) < 1e-3

    @every_integrator
    @pytest.mark.parametrize(("told", "lag"), [(1200.0, 0.02), (300.0, 0.05)])
    def test_rotor_speeds_after_a_step(self, integrator, told, lag):
        batch = at_rest(plain(lag_up_s=0.02, lag_down_s=0.05), np.full(4, 800.0), integrator=integrator)
        for step in range(1, 21):
            batch.fly([[told] * 4])
            expected = told + (800 - told) * np.exp(-step * 0.01 / lag)
            np.testing.assert_allclose(batch.rotor_speed[0], expected, rtol=1e-6)

    @every_integrator
    def test_yaw_step(self, integrator):
        """The rotors carry the weight together; the counter-clockwise ones are faster."""
        data = plain()
        c2, ratio = data["rotors"]["thrust_n"][2], data["rotors"]["torque_ratio_m"]
        told = np.sqrt(hover_speed(data) ** 2 * np.array([1.1, 1.1, 0.9, 0.9]))
        torque = -ratio * c2 * (told**2 @ [1, 1, -1, -1])
        batch = at_rest(data, told, integrator=integrator)
        fly_for(batch, told, 1)
        np.testing.assert_allclose(batch.angular_velocity[0], [0, 0, torque / INERTIA[2]], rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(batch.angular_acceleration[0, 2], torque / INERTIA[2], rtol=1e-3)
        np.testing.assert_allclose(batch.position[0], 0, atol=1e-4)

    @every_frame
    def test_hover_for_ten_seconds(self, name):
        batch = batch_of(frame(name))
        batch.set_pose([[1, 2, 3]])
        fly_for(batch, hovering(frame(name)), 10)
        np.testing.assert_allclose(batch.position[0], [1, 2, 3], atol=1e-4)
        assert angle_between(batch.quat_wxyz, [[1, 0, 0, 0]]) < 1e-3

    @every_integrator
    def test_level_cruise_at_a_tilt(self, integrator):
        k, tilt = 0.3, np.radians(20)
        data = plain(linear_n_per_mps=[k, k, k])
        speed = MASS * GRAVITY * np.tan(tilt) / k
        told = np.full(4, hover_speed(data) / np.sqrt(np.cos(tilt)))
        batch = at_rest(data, told, integrator=integrator)
        # Drag acts along the velocity here, and thrust is tilted.
        batch.set_pose(None, Rotation.from_rotvec([[0, tilt, 0]]).as_quat(scalar_first=True))
        batch.set_velocity([[speed, 0, 0]], None, [told])
        fly_for(batch, told, 2)
        np.testing.assert_allclose(batch.velocity[0], [speed, 0, 0], atol=2e-4)
        np.testing.assert_allclose(batch.position[0], [2 * speed, 0, 0], atol=2e-4)

    @pytest.mark.parametrize("height", [0.07, 0.1, 0.2, 0.6])
    def test_ground_effect(self, height):
        """F / (1 - (r / 4h)^2) at the height h of hubs of radius r; no effect upside down."""
        data = frame()
        room = world_of(room={"min": [-9, -9, 0], "max": [9, 9, 9]})
        gained = []
        for quat_wxyz in ([1.0, 0, 0, 0], [0.0, 1, 0, 0]):
            batch = batch_of(data, physics_hz=1000, worlds=[room], ground_effect=True)
            batch.set_pose([[0, 0, height]], [quat_wxyz])
            batch.fly([hovering(data)], ticks=1)
            gained.append(batch.acceleration[0, 2])
        more = 1 / (1 - (data["rotors"]["radius_m"] / (4 * height)) ** 2)
        assert gained[0] == pytest.approx((more - 1) * GRAVITY, rel=1e-3, abs=5e-4)
        assert gained[1] == pytest.approx(-2 * GRAVITY, rel=1e-3)

    @every_integrator
    def test_axisymmetric_precession(self, integrator):
        moments = np.array([0.0025, 0.0025, 0.0043])
        batch = at_rest(plain(**NO_THRUST, inertia_kgm2=moments.tolist()), integrator=integrator, physics_hz=1000)
        batch.set_velocity(None, [[2.0, 0, 5.0]])
        fly_for(batch, STILL, 1)
        rate = 5.0 * (moments[2] - moments[0]) / moments[0]
        expected = [2 * np.cos(rate), 2 * np.sin(rate), 5.0]
        np.testing.assert_allclose(batch.angular_velocity[0], expected, atol=1e-4)


class TestConservation:
    @every_integrator
    def test_without_torque(self, integrator):
        batch = at_rest(plain(**NO_THRUST), integrator=integrator, physics_hz=1000)
        turn = np.array([12.0, 15.0, 10.0])
        batch.set_velocity(None, [turn])
        momentum, energy = INERTIA * turn, turn @ (INERTIA * turn)
        for _ in range(10):
            fly_for(batch, STILL, 0.1)
            now = batch.angular_velocity.astype(float)
            np.testing.assert_allclose(to_world(batch.quat_wxyz, INERTIA * now)[0], momentum, atol=1e-4 * 0.07)
            np.testing.assert_allclose(now[0] @ (INERTIA * now[0]), energy, rtol=1e-5)

    @every_integrator
    def test_rotors_that_spin_up(self, integrator):
        """The total momentum of body and rotors is conserved while rotor speeds change."""
        spinning = 2e-5
        data = plain(thrust_n=[-100.0, 0.06, 0.0], rotor_inertia_kgm2=spinning, lag_up_s=0.05, lag_down_s=0.1)
        batch = at_rest(data, np.full(4, 300.0), integrator=integrator, physics_hz=1000)
        batch.set_velocity(None, [[3.0, -2.0, 1.0]])

        def momentum():
            rotors = spinning * (batch.rotor_speed[0] @ [1, 1, -1, -1])
            return to_world(batch.quat_wxyz, INERTIA * batch.angular_velocity + rotors * UP)[0]

        before = momentum()
        fly_for(batch, [1600, 1400, 300, 200], 0.5)  # thrust begins at 1667 rad/s
        assert batch.rotor_speed[0, 0] > 1500
        assert abs(batch.angular_velocity[0, 2] - 1.0) > 5  # they turned the body
        np.testing.assert_allclose(momentum(), before, atol=2e-4 * np.linalg.norm(before))

    @pytest.mark.parametrize("part", ["linear_n_per_mps", "quadratic_n_per_mps2", "drag_n_per_radps_mps"])
    def test_drag_takes_energy(self, part):
        """Drag takes energy at any attitude, also with wind from below and from the side."""
        coefficients = [3e-4, 1e-4, 2e-4] if part == "drag_n_per_radps_mps" else [0.3, 0.1, 0.2]
        rotating = {"thrust_n": [-100.0, 0.06, 0.0]}  # rotors spin without thrust
        data, count = plain(**rotating, **{part: coefficients}), 64
        batch, start = batch_of(data, count, physics_hz=1000), Start.random(count, data, seed=5, rates_radps=0)
        start.speed[:] = 800
        start.place(batch)
        fell = np.array([0, 0, -GRAVITY])
        batch.fly(np.full((count, 4), 800.0), ticks=1)
        power = ((batch.acceleration - fell) * start.velocity).sum(1)
        assert (power < 0).all()
        through = to_body(start.quat_wxyz, start.velocity.astype(float))
        fast = np.linalg.norm(through, axis=1, keepdims=True)
        factor = {"linear_n_per_mps": 1.0, "quadratic_n_per_mps2": fast, "drag_n_per_radps_mps": 4 * 800.0}[part]
        force = to_world(start.quat_wxyz, -factor * np.array(coefficients) * through) / MASS
        np.testing.assert_allclose(batch.acceleration - fell, force, rtol=0.02, atol=0.02)

    @every_integrator
    def test_mirror_symmetry(self, integrator):
        """In a mirror, left rotors become right ones with the opposite spin, and the flight is equally valid."""
        data, count = frame(rotor_inertia_kgm2=5e-6, drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5]), 8
        start, rng = Start.random(count, data, seed=3), np.random.default_rng(4)
        flip, swap = np.array([1, -1, 1]), [2, 3, 0, 1]  # swaps front right with front left, rear left with rear right
        mirrored = Start(
            start.position * flip,
            start.quat_wxyz * [1, -1, 1, -1],
            start.velocity * flip,
            start.rates * -flip,
            start.speed[:, swap],
        )
        one, other = batch_of(data, count, integrator=integrator), batch_of(data, count, integrator=integrator)
        start.place(one)
        mirrored.place(other)
        for told in hovering(data) * rng.uniform(0.8, 1.2, (100, count, 4)):
            one.fly(told)
            other.fly(told[:, swap])
        np.testing.assert_allclose(other.position, one.position * flip, atol=5e-5)
        np.testing.assert_allclose(other.angular_velocity, one.angular_velocity * -flip, atol=5e-4)
        assert np.abs(one.position[:, 1]).max() > 0.5

    @every_integrator
    def test_yaw_symmetry(self, integrator):
        """The world has no preferred heading."""
        data, count = frame(), 8
        start, turn = Start.random(count, data, seed=3), Rotation.from_rotvec([0, 0, 1.0])
        turned = Start(
            turn.apply(start.position),
            (turn * Rotation.from_quat(start.quat_wxyz, scalar_first=True)).as_quat(scalar_first=True),
            turn.apply(start.velocity),
            start.rates,
            start.speed,
        )
        one, other = batch_of(data, count, integrator=integrator), batch_of(data, count, integrator=integrator)
        start.place(one)
        turned.place(other)
        fly_for(one, hovering(data, [1.0, 1.05, 0.95, 1.02]), 1)
        fly_for(other, hovering(data, [1.0, 1.05, 0.95, 1.02]), 1)
        np.testing.assert_allclose(other.position, turn.apply(one.position), atol=5e-5)
        np.testing.assert_allclose(other.angular_velocity, one.angular_velocity, atol=5e-4)


class TestSigns:
    @every_frame
    def test_what_each_rotor_does(self, name):
        """Rotors in the order front right, rear left, front left, rear right; negative pitch raises the nose."""
        data = frame(name)
        roll, pitch, yaw = [-1, 1, 1, -1], [-1, 1, -1, 1], [-1, -1, 1, 1]
        for rotor in range(4):
            told = hovering(data, 1 + 0.05 * (np.arange(4) == rotor))
            batch = at_rest(data, told)
            batch.fly([told])
            assert np.sign(batch.angular_velocity[0]).tolist() == [roll[rotor], pitch[rotor], yaw[rotor]]
            assert batch.velocity[0, 2] > 0

    def test_rotors_kick_the_body_against_their_turn(self):
        """Counter-clockwise rotors that accelerate turn the body clockwise, before their torque acts."""
        data = plain(rotor_inertia_kgm2=1e-4, lag_up_s=0.1, lag_down_s=0.1, torque_ratio_m=1e-4)
        batch = at_rest(data, hovering(data))
        told = hovering(data, [1.1, 1.1, 1, 1])
        batch.fly([told], ticks=1)
        assert batch.angular_acceleration[0, 2] == pytest.approx(
            -1e-4 * 2 * 0.1 * hover_speed(data) / 0.1 / INERTIA[2], rel=0.05
        )

    @pytest.mark.parametrize(("turn", "expected"), [([1.0, 0, 0], [0, 1, 0]), ([0, 1.0, 0], [-1, 0, 0])])
    def test_gyroscopic_torque_turns_at_a_right_angle(self, turn, expected):
        """Counter-clockwise rotors: a body that rolls to the right, +x, pitches its nose down, +y."""
        spinning, told = 1e-5, [1500.0, 1500.0, 150.0, 150.0]
        data = plain(rotor_inertia_kgm2=spinning, thrust_n=[-100.0, 0.06, 0.0])
        batch = at_rest(data, told, physics_hz=1000)
        batch.set_velocity(None, [turn])
        batch.fly([told], ticks=1)
        torque = spinning * (np.array(told) @ [1, 1, -1, -1]) * np.array(expected)
        np.testing.assert_allclose(batch.angular_acceleration[0], torque / INERTIA, atol=0.1)

    def test_gravity_pulls_down_at_any_attitude(self):
        data, count = plain(**NO_THRUST), 16
        batch, start = batch_of(data, count), Start.random(count, data, speed_mps=0)
        start.speed[:] = 0
        start.place(batch)
        fly_for(batch, STILL, 0.5)
        np.testing.assert_allclose(batch.velocity, np.tile([0, 0, -GRAVITY / 2], (count, 1)), atol=1e-5)

    def test_angular_velocity_is_of_the_body(self):
        """On its side, with its nose up, a body that rotates about its own x axis rotates about the world's z axis."""
        batch = at_rest(plain(**NO_THRUST))
        nose_up = Rotation.from_rotvec([0, -np.pi / 2, 0])
        batch.set_pose(None, [nose_up.as_quat(scalar_first=True)])
        batch.set_velocity(None, [[1.0, 0, 0]], [STILL])
        fly_for(batch, STILL, 1)
        expected = Rotation.from_rotvec([0, 0, 1.0]) * nose_up
        assert angle_between(batch.quat_wxyz, [expected.as_quat(scalar_first=True)]) < 0.01

    def test_drag_is_along_the_axes_of_the_body(self):
        data = plain(**NO_THRUST, linear_n_per_mps=[0.3, 0.0, 0.0])
        for heading, expected in ((0.0, -0.3 * 2 / MASS), (np.pi / 2, 0.0)):
            batch = at_rest(data)
            batch.set_pose(None, Rotation.from_rotvec([[0, 0, heading]]).as_quat(scalar_first=True))
            batch.set_velocity([[2.0, 0, 0]], None, [STILL])
            batch.fly([STILL], ticks=1)
            np.testing.assert_allclose(batch.acceleration[0], [expected, 0, -GRAVITY], rtol=2e-3, atol=2e-3)

    def test_rotors_never_pull(self):
        data = plain(thrust_n=[-0.5, 0.0, 1.6e-6])  # negative thrust below 559 rad/s is clamped
        batch = at_rest(data, np.full(4, 300.0))
        fly_for(batch, np.full(4, 300.0), 0.5)
        np.testing.assert_allclose(batch.velocity[0], [0, 0, -GRAVITY / 2], atol=1e-5)

    @every_frame
    def test_rotors_keep_to_their_limits(self, name):
        rotors = frame(name)["rotors"]
        batch = batch_of(frame(name), 2)
        fly_for(batch, [[2e6] * 4, [-1e6] * 4], 3)
        np.testing.assert_allclose(batch.rotor_speed[0], rotors["max_speed_radps"], rtol=1e-5)
        np.testing.assert_allclose(batch.rotor_speed[1], rotors["min_speed_radps"], rtol=1e-5, atol=1e-3)

    @pytest.mark.parametrize(("integrator", "lag_s"), SHORT_LAGS)
    def test_lag_shorter_than_a_tick_does_not_overshoot(self, integrator, lag_s):
        data = plain(lag_up_s=lag_s, lag_down_s=lag_s)
        batch = at_rest(data, hovering(data), integrator=integrator, physics_hz=100)
        told = hovering(data, 1.2)
        before = batch.rotor_speed[0].copy()
        for _ in range(20):
            batch.fly([told])
            assert (batch.rotor_speed[0] >= before).all()
            assert (batch.rotor_speed[0] <= told * (1 + 1e-6)).all()
            before = batch.rotor_speed[0].copy()
        np.testing.assert_allclose(before, told, rtol=1e-5)

    def test_rk4_is_refused_where_it_cannot_follow_the_rotors(self):
        data = plain(lag_up_s=3e-3, lag_down_s=0.05)
        with refused(ValueError, "integrator"):
            at_rest(data, hovering(data), integrator="rk4", physics_hz=100)

    def test_rotor_thrusts_are_those_at_rest(self):
        data = frame("crazyflie")
        for share in (0.9, 1.0, 1.2):
            batch = batch_of(data, control="rotor_thrusts")
            fly_for(batch, np.full(4, share * data["mass_kg"] * GRAVITY / 4), 2)
            np.testing.assert_allclose(
                Body([data]).thrust(batch.rotor_speed.astype(float)).sum() / (data["mass_kg"] * GRAVITY),
                share,
                rtol=1e-5,
            )

    def test_another_frame_flies_as_it_says(self):
        """The same rotors accelerate twice the mass half as fast, and with twice the arm they turn it twice as fast."""
        light, heavy = plain(), plain(mass_kg=1.5)
        told = np.full(4, 1800.0)
        gains = []
        for data in (light, heavy):
            batch = at_rest(data, told)
            batch.fly([told], ticks=1)
            gains.append(batch.acceleration[0, 2] + GRAVITY)
        assert gains[0] == pytest.approx(2 * gains[1], rel=1e-4)
        wide = plain(position_m=(2 * np.array(plain()["rotors"]["position_m"])).tolist())
        turns = []
        for data in (light, wide):
            batch = at_rest(data, hovering(data, [1, 1.1, 1.1, 1]))
            batch.fly([hovering(data, [1, 1.1, 1.1, 1])], ticks=1)
            turns.append(batch.angular_acceleration[0, 0])
        assert turns[1] == pytest.approx(2 * turns[0], rel=1e-4)


@pytest.mark.parametrize(("size", "mass"), [(4.0, 1.0), (0.25, 2.0), (1.5, 3.0)])
@every_integrator
def test_scaled_drones_fly_similarly(size, mass, integrator):
    """Lengths scale with `size`, times and velocities with its square root."""
    model = flockstep.DroneModel.from_dict(frame(rotor_inertia_kgm2=5e-6, drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5]))
    data, other_data, time, count = model.to_dict(), model.scaled(size=size, mass=mass).to_dict(), np.sqrt(size), 4
    one = batch_of(data, count, integrator=integrator)
    other = batch_of(other_data, count, 100 / time, 500 / time, integrator=integrator)
    start = Start.random(count, data, seed=8)
    start.place(one)
    scaled = (start.position * size, start.quat_wxyz, start.velocity * time, start.rates / time, start.speed / time)
    Start(*scaled).place(other)
    for told in hovering(data) * np.random.default_rng(9).uniform(0.8, 1.2, (100, count, 4)):
        one.fly(told)
        other.fly(told / time)
    np.testing.assert_allclose(other.position / size, one.position, atol=1e-4)
    np.testing.assert_allclose(other.velocity / time, one.velocity, atol=2e-4)
    np.testing.assert_allclose(other.angular_velocity * time, one.angular_velocity, atol=2e-3)
    assert other_data["mass_kg"] == pytest.approx(mass * data["mass_kg"])
