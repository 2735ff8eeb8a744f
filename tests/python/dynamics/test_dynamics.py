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
