"""Each control's commands on every bundled airframe: the steady state, the limits, and any control by `Batch.fly`."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from rigid_body import FRAMES, FULL, GRAVITY, MIDDLE, angle_between, batch_of, fly_for, frame, rows_of
from scipy.spatial.transform import Rotation

import flockstep

POLICY_HZ = 50
NO_DRAG = {"rotor_drag": False, "body_drag": False}


class Loops:
    """Time constants of the controller's loops in s, derived from the lag of the rotors.

    A lag above 35 ms is shortened by up to a factor of four. With the remaining lag T, the rate loop closes at 0.5 / T,
    and each outer loop at a third of the inner one, the position loop at half of that. The integral of the velocity
    loop v, with drag d over mass, closes at 0.1 v^2 / (v + d).
    """

    def __init__(self, data):
        rotors, drag = data["rotors"], data["drag"]
        hover = flockstep.DroneModel.from_dict(data).hover_speed_radps
        lag = (rotors["lag_up_s"] + rotors["lag_down_s"]) / 2
        rate = 0.5 / lag * np.clip(lag / 0.035, 1, 4)
        velocity = rate / 9
        linear = 4 * hover * max(rotors["drag_n_per_radps_mps"]) + max(drag["linear_n_per_mps"])
        slowed = (linear + 4 * max(drag["quadratic_n_per_mps2"])) / data["mass_kg"]
        self.yaw_rate = 3 / rate
        self.attitude = 3 / rate
        self.yaw = 9 / rate
        self.velocity = 1 / velocity
        self.integral = (velocity + slowed) / (0.1 * velocity**2)
        self.position = 2 / velocity


def flight(data, control, commands, seconds, **settings):
    """Rows of states (T, K, 17) after every step of one command each, (K, 4), from a hover at the origin."""
    batch = batch_of(data, len(commands), POLICY_HZ, control=control, **settings)
    states = []
    for _ in range(round(seconds * POLICY_HZ)):
        batch.fly(commands)
        states.append(rows_of(batch))
    return np.array(states)


def axes(states):
    """The body's axes in the world, (..., 3) each: forward, left, up."""
    quats = states[..., 3:7].reshape(-1, 4)
    columns = Rotation.from_quat(quats, scalar_first=True).as_matrix().reshape(*states.shape[:-1], 3, 3)
    return columns[..., 0], columns[..., 1], columns[..., 2]


def heading(states):
    forward, _, _ = axes(states)
    return np.arctan2(forward[..., 1], forward[..., 0])


def tilt_deg(states):
    return np.degrees(np.arccos(np.clip(axes(states)[2][..., 2], -1, 1)))


@pytest.fixture(params=FRAMES)
def data(request):
    return frame(request.param)


def test_body_rates(data):
    commands = [[GRAVITY, 1, 0, 0], [GRAVITY, 0, -0.5, 0], [GRAVITY, 0.3, 0.2, 0.4]]
    loops = Loops(data)
    states = flight(data, "body_rates", commands, 6 * loops.yaw_rate, gyroscopic=False, **NO_DRAG)
    np.testing.assert_allclose(states[-1, :, 10:13], np.array(commands)[:, 1:], atol=0.01)


def test_thrust_is_over_the_mass(data):
    commands = [[GRAVITY, 0, 0, 0], [8.0, 0, 0, 0], [12.0, 0, 0, 0]]
    for control in ("body_rates", "attitude"):
        states = flight(data, control, commands, 2, **NO_DRAG)
        gained = (states[-1, :, 9] - states[-11, :, 9]) * POLICY_HZ / 10
        np.testing.assert_allclose(gained, np.array(commands)[:, 0] - GRAVITY, atol=2e-3)


@pytest.mark.parametrize(
    ("commands", "settings", "off_deg"),
    [
        ([[GRAVITY, 0.3, 0, 0], [GRAVITY, 0, -0.3, 0], [GRAVITY, 0, 0, 2.0], [GRAVITY, 0.2, -0.3, 1.0]], NO_DRAG, 0.2),
        # Drag of rotors above or below the centre of mass tilts the body as it gains speed.
        ([[GRAVITY, 0.2, 0, 0], [GRAVITY, 0, -0.2, 1.0]], {}, 2),
    ],
)
def test_attitude(data, commands, settings, off_deg):
    """Yaw, then pitch, then roll, each about the axis after the previous rotations."""
    states = flight(data, "attitude", commands, 12 * Loops(data).yaw, **settings)
    asked = Rotation.from_euler("ZYX", np.array(commands)[:, [3, 2, 1]]).as_quat(scalar_first=True)
    assert (angle_between(states[-1, :, 3:7], asked) < off_deg).all()


INVERTED = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0.6, 0.8, 0], [6e-17, 1, 0, 0], [1e-4, 1, 0, 0]], float)


@pytest.mark.parametrize(
    ("control", "command"),
    [("attitude", [GRAVITY, 0, 0, 0]), ("velocity", [0, 0, 0, 0]), ("position", [0, 0, 0, 0])],
)
def test_an_inverted_drone_rights_itself(data, control, command):
    """Exactly upside down all axes are equally good, so any of them may be used."""
    loops = Loops(data)
    batch = batch_of(data, len(INVERTED), POLICY_HZ, control=control)
    batch.set_pose(None, INVERTED / np.linalg.norm(INVERTED, axis=1, keepdims=True))
    fly_for(batch, command, {"attitude": 8 * loops.attitude}.get(control, 8 * loops.position), POLICY_HZ)
    assert tilt_deg(rows_of(batch)).max() < 5


def test_a_heading_straight_behind(data):
    """At half a turn both directions are equally short; float32's pi is off by 9e-8."""
    batch = batch_of(data, 2, POLICY_HZ, control="position")
    fly_for(batch, [[0, 0, 0, np.pi], [0, 0, 0, -np.pi]], 12 * Loops(data).yaw, POLICY_HZ)
    assert np.abs(np.abs(heading(rows_of(batch))) - np.pi).max() < 0.02


def test_acceleration(data):
    commands = np.array([[1.0, 0, 0, 0], [0, -2.0, 0.5, 0.5], [-1, 1, -1, -2.0]])
    states = flight(data, "acceleration", commands, 12 * Loops(data).yaw, **NO_DRAG)
    gained = (states[-1, :, 7:10] - states[-11, :, 7:10]) * POLICY_HZ / 10
    np.testing.assert_allclose(gained, commands[:, :3], atol=0.02)
    np.testing.assert_allclose(heading(states[-1]), commands[:, 3], atol=0.01)


@pytest.mark.parametrize("control", ["velocity", "heading_velocity"])
def test_velocity(data, control):
    commands = np.array([[2.0, -1.0, 0.5, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 1.0, 0.0, 0.0]])
    loops = Loops(data)
    batch = batch_of(data, 3, POLICY_HZ, control=control)
    turned = 2.0
    batch.set_pose(None, np.tile(Rotation.from_rotvec([0, 0, turned]).as_quat(scalar_first=True), (3, 1)))
    fly_for(batch, commands, 4 * loops.velocity + 4 * loops.integral, POLICY_HZ)
    asked = commands[:, :3]
    if control == "heading_velocity":
        asked = Rotation.from_rotvec([0, 0, turned]).apply(asked)
    np.testing.assert_allclose(batch.velocity, asked, atol=0.05)
    np.testing.assert_allclose(heading(rows_of(batch)), turned, atol=0.01)


@pytest.mark.parametrize("control", ["velocity", "heading_velocity"])
def test_yaw_rate(data, control):
    """Yaw rate has only proportional control, so rotor drag reduces it by up to an eighth."""
    commands = np.array([[0, 0, 0, 0.4], [0, 0, 0, -1.0]])
    states = flight(data, control, commands, 6 * Loops(data).yaw_rate)
    share = states[-1, :, 12] / commands[:, 3]
    assert ((share > 7 / 8) & (share < 1.01)).all()


def test_position(data):
    loops = Loops(data)
    commands = np.array([[3.0, -2.0, 1.0, 1.0], [-1.0, 0.0, -2.0, -2.0], [0, 0, 0, 3.0]])
    states = flight(data, "position", commands, 5 * loops.position + 6 * loops.integral)
    np.testing.assert_allclose(states[-1, :, :3], commands[:, :3], atol=0.02)
    np.testing.assert_allclose(heading(states[-1]), commands[:, 3], atol=0.01)
    way = np.linalg.norm(commands[:2, :3], axis=1)
    along = (states[:, :2, :3] * (commands[:2, :3] / way[:, None])).sum(-1)
    assert (along.max(0) < 1.1 * way).all()  # overshoot of a tenth


def test_limits(data):
    """Allow an overshoot of an eighth of the rates, a sixth of the speed, and one degree of tilt."""
    loops = Loops(data)
    limits = {"max_tilt_deg": 30.0, "max_rate_dps": 300.0, "max_yaw_rate_dps": 100.0, "max_speed_mps": 4.0}
    seconds = 8 * loops.velocity
    far = flight(data, "position", np.array([[300.0, -200, 50, 3], [0, 90, -300, -3]]), seconds, **limits)
    fast = flight(data, "velocity", np.array([[50.0, 0, 0, 9], [0, -30, -30, -9]]), seconds, **limits)
    for states in (far, fast):
        assert np.linalg.norm(states[..., 7:10], axis=-1).max() < 4.0 * 7 / 6
        assert np.degrees(np.abs(states[..., 10:12])).max() < 300 * 9 / 8
        assert np.degrees(np.abs(states[..., 12])).max() < 100 * 1.05
        assert tilt_deg(states).max() < 31
    pushed = flight(data, "acceleration", np.array([[50.0, 0, 0, 3], [0, -50, 3, -3]]), 12 * loops.attitude, **limits)
    assert tilt_deg(pushed).max() < 31
    assert tilt_deg(pushed)[-1].min() > 25
    spun = flight(
        data, "body_rates", np.array([[GRAVITY, 99, 0, 0], [GRAVITY, 0, -99, 0], [GRAVITY, 0, 0, 99]]), 3, **limits
    )
    assert np.degrees(np.abs(spun[..., 10:12])).max() < 300 * 9 / 8
    assert np.degrees(np.abs(spun[..., 12])).max() < 100 * 1.05
    assert np.degrees(np.abs(spun[-1, 0, 10])) > 250


def test_acceleration_keeps_to_its_limit(data):
    states = flight(
        data, "acceleration", np.array([[50.0, 0, 0, 0]]), 10 * Loops(data).attitude, max_acceleration_mps2=2.0
    )
    gained = np.diff(states[:, 0, 7]) * POLICY_HZ
    assert 1.0 < gained.max() < 2.2


def test_rates_of_the_controller_are_those_of_the_clock():
    """The controller runs at every fifth tick; between, the rotor commands stay."""
    batch = batch_of(frame(), control="body_rates", controller_hz=100)
    every = batch_of(frame(), control="body_rates", physics_hz=500)
    for _ in range(50):
        batch.fly([[GRAVITY, 1.0, 0, 0]])
        every.fly([[GRAVITY, 1.0, 0, 0]])
    assert batch.angular_velocity[0, 0] == pytest.approx(1, abs=0.02)
    assert not np.array_equal(batch.rotor_speed, every.rotor_speed)


def test_the_controller_keeps_its_rate_however_the_calls_are_cut():
    def flown(calls, ticks):
        batch = batch_of(frame(), 1, 50, control="velocity", controller_hz=50)
        for _ in range(calls):
            batch.fly([[1.0, 0, 0.5, 0]], ticks=ticks)
        return rows_of(batch)

    np.testing.assert_allclose(flown(1, 200), flown(200, 1), atol=1e-4)


FAR = np.array([[1000.3, 1000.1, 999.7]], np.float32)


@pytest.mark.parametrize("offset_m", [(0, 0, 0), (0.5, -0.3, 0.2)])
def test_hover_far_from_the_origin(offset_m):
    """It stays at, or flies to, a target 1 km out along each axis; its mean over the last five seconds of a minute."""
    batch = batch_of(frame(), 1, POLICY_HZ, control="position")
    batch.set_pose(FAR + np.float32(offset_m))
    command = np.concatenate([FAR, [[0]]], axis=1)
    places = []
    for step in range(60 * POLICY_HZ):
        batch.fly(command)
        if step >= 55 * POLICY_HZ:
            places.append(batch.position[0].astype(float))
    assert np.linalg.norm(np.mean(places, axis=0) - FAR[0]) < 1e-3


DRONES, STEPS = 21, 12


def commands(control):
    return np.random.default_rng(5).uniform(0.8, 1.2, (STEPS, DRONES, 4)) * MIDDLE[control]


def made(control, **settings):
    """Fast drones in gusts, in a room that some of them hit, with a controller slower than the physics."""
    room = world_of(room={"min": [-1] * 3, "max": [1] * 3})
    wind = flockstep.WindConfig(mean_mps=(1.0, 0.5, 0.0), gusts="ornstein_uhlenbeck")
    defaults = {"control": control, "on_contact": "bounce", "ground_effect": True, "wind": wind, "controller_hz": 250}
    batch = batch_of(FULL, DRONES, 50, num_threads=2, block_size=8, worlds=[room], **defaults | settings)
    rng = np.random.default_rng(6)
    batch.set_pose(rng.uniform(-0.7, 0.7, (DRONES, 3)))
    batch.set_velocity(rng.uniform(-4, 4, (DRONES, 3)))
    return batch


def bits(batch):
    return np.concatenate([rows_of(batch), batch.acceleration, batch.angular_acceleration, batch.contact.point], axis=1)


@pytest.mark.parametrize("integrator", ["automatic", "midpoint", "rk4"])
@pytest.mark.parametrize("control", MIDDLE)
def test_the_bits_are_those_of_a_batch_made_with_the_control(control, integrator):
    usual = made(control, integrator=integrator)
    others = [made(other, integrator=integrator) for other in ("pose", *MIDDLE) if other != control]
    hit = np.zeros(DRONES, bool)
    for command in commands(control):
        hit |= usual.fly(command).hit
        for other in others:
            other.fly(command, control=control)
    assert hit.any()
    assert np.ptp(usual.velocity, axis=0).min() > 0
    for other in others:
        np.testing.assert_array_equal(bits(other), bits(usual))
    named = made(control, integrator=integrator)
    for command in commands(control):
        named.fly(command, control=control)
    assert named.snapshot() == usual.snapshot()


def test_the_control_may_change_from_call_to_call():
    """Three batches, each made with another control, fly the same sequence of commands with the same bits."""
    order = ["velocity", "rotor_thrusts", "attitude", "position", "body_rates", "heading_velocity"] * 2
    batches = [made(control) for control in ("velocity", "rotor_speeds", "position")]
    for step, control in enumerate(order):
        for batch in batches:
            same = batch.dynamics.control == control
            batch.fly(commands(control)[step], ticks=7, control=None if same else control)
    for batch in batches[1:]:
        np.testing.assert_array_equal(bits(batch), bits(batches[0]))


def windy(control):
    wind = flockstep.WindConfig(mean_mps=(4.0, 0.0, 0.0))
    return batch_of(frame("x500"), 2, control=control, wind=wind)


def pushed_back(batch):
    """Hold against the wind until the integral of the velocity error has grown."""
    for _ in range(100):
        batch.fly(np.zeros((2, 4)), control="velocity")


def test_controls_of_the_velocity_error_share_its_integral():
    """At a velocity of 0 the forward direction does not matter, so both controls do the same from then on."""
    usual, other = windy("velocity"), windy("rotor_thrusts")
    for batch in (usual, other):
        pushed_back(batch)
    for _ in range(5):
        usual.fly(np.zeros((2, 4)))
        other.fly(np.zeros((2, 4)), control="heading_velocity")
    np.testing.assert_array_equal(rows_of(other), rows_of(usual))


@pytest.mark.parametrize("between", ["rotor_speeds", "rotor_thrusts", "body_rates", "attitude", "acceleration"])
def test_the_other_controls_reset_the_integral(between):
    """Afterwards the controller does what it does for a drone that begins in this state."""
    used, fresh, kept = windy("velocity"), windy("velocity"), windy("velocity")
    hover = {"rotor_speeds": 4 * [600], "rotor_thrusts": 4 * [5]}.get(between, [9.81, 0, 0, 0])
    pushed_back(used)
    used.fly(np.tile(hover, (2, 1)), control=between)
    pushed_back(kept)  # its integral is that of the hold
    for batch in (fresh, kept):
        if batch is fresh:
            batch.set_pose(used.position, used.quat_wxyz)
        batch.set_velocity(used.velocity, used.angular_velocity, used.rotor_speed)
    for batch in (used, fresh, kept):
        batch.fly(np.zeros((2, 4)))
    np.testing.assert_array_equal(used.velocity, fresh.velocity)
    np.testing.assert_array_equal(used.rotor_speed, fresh.rotor_speed)
    assert (kept.velocity != fresh.velocity).any()  # the integral makes a difference here


@pytest.mark.parametrize(
    ("command", "control", "match"),
    [
        ([10, 90, 0, 0], "attitude", ('command of control "attitude" (row 1)', 90)),
        ([10, 0, -90, 0], "attitude", ('command of control "attitude" (row 1)', -90)),
        ([0, 0, 0, 2e4], "position", ('command of control "position" (row 1)', 20000)),
        ([0, 0, 3e6, 0], "velocity", ('command of control "velocity" (row 1)',)),
        ([np.nan, 0, 0, 0], "rotor_speeds", ('command of control "rotor_speeds" (row 1)',)),
        ([0, 0, 0, 0], "pose", ("control", "pose")),
        ([0, 0, 0, 0], "velocty", ("control", "pose", "velocty")),
        ([0, 0, 0, 0], 3, ("control", 3)),
    ],
)
@pytest.mark.parametrize("usual", ["body_rates", "velocity"])
def test_refusals(usual, command, control, match):
    batch = batch_of(frame(), 2, control=usual)
    before = batch.snapshot()
    with refused((ValueError, TypeError), *match):
        batch.fly([[0, 0, 0, 0], command], control=control)
    assert batch.snapshot() == before


def test_the_limits_are_those_of_the_control_of_the_call():
    """90 is too much for a roll in radians, but not for a body rate."""
    batch = batch_of(frame(), 2, control="attitude")
    batch.fly([[10, 90, 0, 0]] * 2, control="body_rates")
    assert (batch.angular_velocity[:, 0] > 0).all()
