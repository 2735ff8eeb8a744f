"""`Batch.fly` takes commands of any control, whatever control the batch was made with."""

import numpy as np
import pytest
from messages import refused
from rigid_body import OPEN, batch_of, frame, rows_of

import flockstep

FULL = frame(rotor_inertia_kgm2=5e-6, drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5])
MIDDLE = {  # a command of each control that keeps a kingfisher in the air
    "rotor_speeds": [1000, 1100, 1050, 1080],
    "rotor_thrusts": [1.7, 1.9, 1.8, 1.85],
    "body_rates": [10, 0.5, -0.3, 0.4],
    "attitude": [10, 0.2, -0.1, 0.5],
    "acceleration": [1, -2, 0.5, 0.3],
    "velocity": [1, -2, 0.5, 0.3],
    "heading_velocity": [1, -2, 0.5, 0.3],
    "position": [1, -2, 0.5, 0.3],
}
DRONES, STEPS = 21, 12


def commands(control):
    return np.random.default_rng(5).uniform(0.8, 1.2, (STEPS, DRONES, 4)) * MIDDLE[control]


def made(control, **settings):
    """Fast drones in gusts, in a room that some of them hit, with a controller slower than the physics."""
    room = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-1] * 3, "max": [1] * 3}})
    wind = flockstep.WindConfig(mean_mps=(1.0, 0.5, 0.0), gusts="ornstein_uhlenbeck")
    defaults = {"motion": "rotors", "control": control, "on_contact": "bounce", "ground_effect": True, "wind": wind}
    batch = flockstep.Batch(
        [room],
        DRONES,
        drone=flockstep.DroneModel.from_dict(FULL),
        dynamics=flockstep.DynamicsConfig(**{**defaults, **settings}),
        clock=flockstep.ClockConfig(policy_hz=50, controller_hz=250, physics_hz=500),
        num_threads=2,
        block_size=8,
    )
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
    ],
)
@pytest.mark.parametrize("usual", ["body_rates", "velocity"])
def test_refusals(usual, command, control, match):
    batch = batch_of(frame(), 2, control=usual)
    before = batch.snapshot()
    with refused(ValueError, *match):
        batch.fly([[0, 0, 0, 0], command], control=control)
    assert batch.snapshot() == before


def test_the_limits_are_those_of_the_control_of_the_call():
    """90 is too much for a roll in radians, but not for a body rate."""
    batch = batch_of(frame(), 2, control="attitude")
    batch.fly([[10, 90, 0, 0]] * 2, control="body_rates")
    assert (batch.angular_velocity[:, 0] > 0).all()


def test_wrong_types_and_motions():
    batch = batch_of(frame(), 2)
    with refused(TypeError, "control", 3):
        batch.fly(np.zeros((2, 4)), control=3)
    with refused(RuntimeError, "motion by rotors"):
        flockstep.Batch([OPEN], 2).fly(np.zeros((2, 4)), control="velocity")
    with refused(RuntimeError, 'control="pose"'):
        made("pose").fly(np.zeros((DRONES, 4)))
