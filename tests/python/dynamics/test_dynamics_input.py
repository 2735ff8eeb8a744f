"""Bad input to rotor flight: rejected with the field, the expected and the given value, before anything changes."""

import math

import numpy as np
import pytest
from conftest import begun, flat_batch, placed
from gymnasium import spaces
from messages import refused
from rigid_body import FRAMES, OPEN, batch_of, frame, plain

import flockstep

NAN, INF = math.nan, math.inf


def refuses(call, *said, error=ValueError):
    with refused(error, *said):
        call()


def made(drone=None, **fields):
    """A batch of one rotor-driven drone, with some settings changed."""
    usual = {"motion": "rotors", "control": "velocity", "policy_hz": 50}
    return flat_batch([OPEN], drone=drone, **usual | fields)


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("motion", "hover", ("kinematic", "rotors")),
        ("control", "speed", ("pose", "rotor_speeds")),
        ("integrator", "euler", ("automatic", "midpoint", "rk4")),
        ("on_contact", "crash", ("terminate", "stop", "bounce")),
    ],
)
def test_dynamics_config(field, value, named):
    refuses(lambda: made(**{field: value}), field, value, *named)


@pytest.mark.parametrize(
    ("field", "value"), [("max_speed_mps", "5"), *(("rotor_lag", bad) for bad in ("yes", None, 2, "no", 1.0, []))]
)
def test_dynamics_config_of_wrong_types(field, value):
    refuses(lambda: made(**{field: value}), field, value, error=TypeError)


def test_kinematic_motion_takes_only_poses():
    refuses(lambda: made(motion="kinematic"), "control", "pose", "rotors", "velocity")


@pytest.mark.parametrize(
    ("field", "bad", "others", "limits"),
    [
        *(("policy_hz", bad, {}, (0.001, 100_000)) for bad in (0, -1, NAN, INF)),
        *(("physics_hz", bad, {}, (50, 1000)) for bad in (25, 75)),
        *((name, bad, {}, (0,)) for name in ("physics_hz", "controller_hz") for bad in (0, -50, NAN)),
        ("physics_hz", 40, {"policy_hz": 10}, (50,)),
        *(("controller_hz", bad, {}, (500,)) for bad in (75, 200, 1000)),
        ("policy_hz", 0.1, {"physics_hz": None}, (0.5,)),
        ("controller_hz", 125, {}, (50,)),
    ],
)
def test_clock_config(field, bad, others, limits):
    refuses(lambda: made(**{"physics_hz": 500} | others | {field: bad}), field, bad, *limits)


@pytest.fixture
def batch():
    batch = batch_of(frame(), 2, control="velocity")
    batch.fly([[1, 0, 0, 0], [0, 1, 0, 0]])
    return batch


def rows(values):
    """Two rows, of which the second is bad."""
    return [[0.0] * len(values), values]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        *(({"command": rows([0, bad, 0, 0])}, ("command (row 1)", bad)) for bad in (NAN, INF, -INF)),
        ({"command": rows([0, 2.1e6, 0, 0])}, ("command (row 1)",)),
        ({"command": [[0] * 4]}, ("command", (2, 4), (1, 4))),
        ({"command": [[0] * 3] * 2}, ("command", (2, 4), (2, 3))),
        ({"command": [["a"] * 4] * 2}, ("command",)),
        ({"command": None}, ("command", None)),
        *(({"command": [[0] * 4] * 2, "ticks": bad}, ("ticks", bad)) for bad in (0, -1, 10**7)),
        ({"command": [[0] * 4] * 2, "mask": [1, 0]}, ("mask", bool)),
        ({"command": [[0] * 4] * 2, "mask": [True]}, ("mask", (2,))),
    ],
)
def test_fly(batch, arguments, said):
    before = batch.snapshot()
    refuses(lambda: batch.fly(**arguments), *said)
    assert batch.snapshot() == before


@pytest.mark.parametrize(
    ("control", "column", "most", "named"),
    [
        ("attitude", 1, math.pi, "roll"),
        ("attitude", 2, math.pi, "pitch"),
        *((control, 3, 1e4, "yaw") for control in ("attitude", "acceleration", "position")),
    ],
)
def test_angles(control, column, most, named):
    batch = batch_of(frame(), 2, control=control)
    before = batch.snapshot()
    command = [9.81 if control == "attitude" else 0, 0, 0, 0]
    for command[column] in (45.0, -90.0) if most < 4 else (2e4, -3e4):
        refuses(lambda: batch.fly(rows(command)), "command (row 1)", named, f"{command[column]:g}")
    assert batch.snapshot() == before
    command[column] = -most if most < 4 else -12
    batch.fly(rows(command))
    if most > 4:
        command[column] = -most
        with refused(RuntimeWarning, "command (row 1)", -10000):
            batch.fly(rows(command))


@pytest.mark.parametrize("control", ["rotor_speeds", "body_rates", "velocity", "heading_velocity"])
def test_invalid_angles(control):
    batch_of(frame(), 2, control=control).fly([[45.0] * 4, [2e4] * 4])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        *(({"velocity": rows([0, 0, bad])}, ("velocity (row 1)",)) for bad in (NAN, INF, -1.1e4)),
        *(({"angular_velocity": rows([0, 0, bad])}, ("angular_velocity (row 1)",)) for bad in (NAN, INF, -1600)),
        *(({"rotor_speed": rows([0, 0, 0, bad])}, ("rotor_speed (row 1)", bad)) for bad in (NAN, -1, 2333)),
        ({"velocity": [[0, 0]] * 2}, ("velocity", (2, 3), (2, 2))),
        ({"rotor_speed": [[0, 0, 0]] * 2}, ("rotor_speed", (2, 4), (2, 3))),
        # A good field before a bad one is not set either.
        ({"velocity": [[1, 1, 1]] * 2, "rotor_speed": [[-1] * 4] * 2}, ("rotor_speed (row 0)", -1)),
    ],
)
def test_set_velocity(batch, arguments, said):
    before = batch.snapshot()
    refuses(lambda: batch.set_velocity(**arguments), *said)
    assert batch.snapshot() == before


STIFF = {
    "rotor drag": lambda: frame("crazyflie", drag_n_per_radps_mps=[1e-2] * 3),
    "inertia": lambda: frame("x500", inertia_kgm2=[1e-9] * 3),
    "spin": lambda: plain("x500", inertia_kgm2=[1e-7] * 3, rotor_inertia_kgm2=1e-4),
}


@pytest.mark.parametrize("why", STIFF)
def test_an_airframe_too_stiff_for_the_tick_is_refused(why):
    refuses(lambda: batch_of(STIFF[why]()), "drone", 1000, 1)


def test_every_shipped_frame_flies_at_the_usual_tick_and_twice_of_it():
    for name in FRAMES:
        batch_of(frame(name), physics_hz=200)


def two(interaction, inertia=1e-9, **keywords):
    """Two drones of one env, close together; uneven thrusts turn their tiny inertia too fast at once."""
    data = plain("x500", inertia_kgm2=[inertia] * 3)
    batch = batch_of(data, 2, 10, drones_per_env=2, interaction=interaction, **keywords)
    batch.set_pose([[-0.33, 0, 0], [0.33, 0, 0]])
    return batch


ONE_SPINS = [[500] * 4, [500, 600, 500, 500]]
FAR = flockstep.BodyConfig(shape="sphere", position_m=(100, 0, 0))


@pytest.mark.parametrize(
    "keywords",
    [
        {"interaction": "none"},
        {"interaction": "collide"},  # they are near each other, and fly tick by tick
        {"interaction": "collide", "on_contact": "bounce"},
        {"interaction": "none", "bodies": [FAR]},  # all drones fly tick by tick
        {"interaction": "collide", "bodies": [FAR]},
    ],
)
@pytest.mark.parametrize("ticks", [1, 50, 2500])
def test_a_lost_drone_is_counted_once_and_rests(keywords, ticks):
    batch = two(**keywords)
    before = batch.position.copy()
    with refused(RuntimeWarning, "fly()", 1):
        batch.fly(ONE_SPINS, ticks=ticks)
    np.testing.assert_array_equal(batch.position[1], before[1])
    np.testing.assert_array_equal(batch.velocity[1], 0)
    assert batch.velocity[0, 2] != 0
    batch.fly([[500] * 4] * 2, ticks=3)
    assert batch.velocity[1, 2] != 0  # it flies again


def test_a_drone_that_is_stopped_before_it_is_lost_is_not_lost():
    """Alone, it would soon spin too fast. The other one hits it first, after which it stays until the next call."""

    def flown(interaction):
        batch = two(interaction, 5e-6)
        batch.set_pose([[-0.4, 0, 0], [0.4, 0, 0]])
        batch.set_velocity([[60, 0, 0], [0, 0, 0]])
        batch.fly(ONE_SPINS, ticks=50)
        return batch

    with refused(RuntimeWarning, "fly()", 1):
        flown("none")
    met = flown("collide")
    assert met.contact.hit.tolist() == [True, True]
    assert np.linalg.norm(met.position[1] - [0.4, 0, 0]) < 0.1


def test_a_lost_flight_ends_the_episode_as_a_bad_state():
    stiff = flockstep.DroneModel.from_dict(plain("x500", inertia_kgm2=[1e-9] * 3))
    envs = begun(2, task=flockstep.HoverConfig(), drone=stiff)
    actions = np.zeros((2, 4), np.float32)
    actions[1] = [0.5, 0.6, 0.5, 0.5]
    infos = envs.step(actions)[-1]
    assert infos["bad_state"][1]


@pytest.mark.parametrize("control", ["rotor_speeds", "body_rates"])
def test_fast_turns_stay_unit_quaternions(control):
    """Rotations of up to half a turn per tick, with both integrators."""
    turns = np.array([10.0, 600, 1200, 1500, 1570])
    batch = batch_of(plain("x500"), len(turns), control=control)
    batch.set_velocity(angular_velocity=np.outer(turns, [0, 0, 1]))
    for _ in range(20):
        batch.fly(np.tile([400.0] * 4 if control == "rotor_speeds" else [9.81, 0, 0, 0], (len(turns), 1)), ticks=1)
        assert np.abs(np.linalg.norm(batch.quat_wxyz.astype(float), axis=1) - 1).max() < 3e-7
    assert (batch.angular_velocity[:, 2] > 0.9 * turns).all()


def test_each_motion_has_its_calls(batch):
    before = batch.snapshot()
    refuses(lambda: batch.move([[0, 0, 0]] * 2), "move() is for kinematic motion", error=RuntimeError)
    assert batch.snapshot() == before
    kinematic = flockstep.Batch([OPEN], 1)
    before = kinematic.snapshot()
    refuses(lambda: kinematic.fly([[0] * 4]), "fly() is for motion by rotors", error=RuntimeError)
    refuses(lambda: kinematic.set_velocity([[0] * 3]), "set_velocity() is for motion by rotors", error=RuntimeError)
    for name in ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "rotor_speed"):
        refuses(lambda name=name: getattr(kinematic, name), 'motion="rotors"', error=AttributeError)
    assert kinematic.snapshot() == before
    refuses(lambda: made(control="pose").fly([[0] * 4]), "fly", "pose", error=RuntimeError)


def test_a_drone_without_an_airframe_cannot_fly_by_rotors():
    hull = flockstep.DroneModel(frame()["hull_m"])
    refuses(lambda: made(drone=hull), "drone", "only a hull")
    refuses(lambda: hull.mass_kg, "only a hull", error=AttributeError)
    refuses(lambda: hull.scaled(size=2), "drone", "only a hull")


LEFT_OUT = object()


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        *(("mass_kg", bad, ("mass_kg", 0.0001, 10000, bad)) for bad in (-1, 0, 100_000)),
        ("mass_kg", "heavy", ("mass_kg", "heavy")),
        ("mass_kg", None, ("mass_kg", "null")),
        ("mass_kg", 4.0, ("rotors", "thrust-to-weight", "0.866192")),
        ("inertia_kgm2", [-1, 1, 1], ("inertia_kgm2[0]", "1e-12", 1000000000, -1)),
        ("inertia_kgm2", [1, 1, 0], ("inertia_kgm2[2]", "1e-12", 1000000000, 0)),
        (
            "inertia_kgm2",
            [1.43e-5, 1.43e-5, 2.89e-5],  # from a published table
            ("inertia_kgm2", "1.43e-05, 1.43e-05, 2.89e-05", "inertia_kgm2[2] to 2.86e-05"),
        ),
        ("inertia_kgm2", [3, 1, 1], ("inertia_kgm2", "3, 1, 1", "inertia_kgm2[0] to 2")),
        *(("inertia_kgm2", bad, ("inertia_kgm2", 3)) for bad in ([1, 1], 0.1)),
        ("rotors", [], ("rotors",)),
        ("rotors/spin", ["ccw"] * 4, ("rotors", "turn the body")),
        ("rotors/spin", ["ccw", "left", "cw", "cw"], ("spin/1", "ccw", "cw", "left")),
        ("rotors/spin", ["ccw"], ("rotors spin", 4, 1)),
        ("rotors/position_m", [[0, 0, 0]] * 4, ("rotors", "turn the body")),
        ("rotors/position_m", [[0.1, 0.1, 0]] * 3, ("position_m",)),
        ("rotors/position_m", [[0.1, 0.1]] * 4, ("position_m/0", 3)),
        ("rotors/position_m", [[1000, 0.1, 0]] * 4, ("position_m[0][0]", "+-100", 1000)),
        ("rotors/thrust_n", [0, 0, 1e-7], ("rotors", "thrust-to-weight")),
        ("rotors/thrust_n", [0, 0, -1e-6], ("thrust_n[2]", 0)),
        ("rotors/thrust_n", [0, 0, 0], ("thrust_n", "positive")),
        ("rotors/thrust_n", [1.0, -0.001, 1.6e-6], ("thrust_n", "grows")),
        ("rotors/thrust_n", [0, 0], ("thrust_n", 3)),
        ("rotors/max_thrust_n", 8.0, ("rotors", "thrust_n", "max_thrust_n")),
        ("rotors/max_speed_radps", 0, ("max_speed_radps", "0.001", 100000, 0)),
        ("rotors/min_speed_radps", -1, ("min_speed_radps", 0, -1)),
        ("rotors/min_speed_radps", 3000, ("min_speed_radps", "max_speed_radps", 3000)),
        ("rotors/min_speed_radps", 2000, ("min_speed_radps", "weight", 2000)),
        ("rotors/torque_ratio_m", 0, ("torque_ratio_m",)),
        ("rotors/lag_up_s", -0.1, ("lag_up_s", 0, 10, "-0.1")),
        ("rotors/lag_down_s", 11, ("lag_down_s", 0, 10, 11)),
        ("rotors/radius_m", -1, ("radius_m",)),
        ("rotors/inertia_kgm2", -1, ("rotors inertia_kgm2", 0, 1000000, -1)),
        ("rotors/drag_n_per_radps_mps", [0, -1, 0], ("drag_n_per_radps_mps[1]", 0, 1000000, -1)),
        ("rotors/lift_n_per_mps2", -1, ("lift_n_per_mps2", 0, 1000000, -1)),
        ("drag/linear_n_per_mps", [0, 0, -1], ("linear_n_per_mps[2]", 0, 1000000, -1)),
        ("drag/quadratic_n_per_mps2", [0, 0], ("quadratic_n_per_mps2", 3)),
        ("drag/cubic", [0, 0, 0], ("drag/cubic", "unknown field")),
        ("rotors/colour", "red", ("rotors/colour", "unknown field")),
        ("wings", 2, ("wings", "unknown field")),
        ("name", 3, ("name", 3)),
        ("like", "x501", ("crazyflie", "x501")),
        ("scaled", {"size": 2}, ("scaled", "like")),
        ("flockstep_drone", 2, ("flockstep_drone", 1, 2)),
        *(
            (field, LEFT_OUT, (field.rpartition("/")[2],))
            for field in (
                *("flockstep_drone", "mass_kg", "inertia_kgm2", "rotors", "rotors/position_m", "rotors/spin"),
                *("rotors/thrust_n", "rotors/max_speed_radps", "rotors/torque_ratio_m"),
            )
        ),
        ("hull_m", LEFT_OUT, ("size_m",)),
        ("hull_m", [[0, 0, 0]] * 5, ("hull",)),
    ],
)
def test_drone_data(place, value, said):
    data = frame()
    *groups, field = place.split("/")
    home = data[groups[0]] if groups else data
    if value is LEFT_OUT:
        del home[field]
    else:
        home[field] = value
    refuses(lambda: flockstep.DroneModel.from_dict(data), "drone", *said)


@pytest.mark.parametrize("data", [None, [], "x"])
def test_drone_data_of_wrong_types(data):
    refuses(lambda: flockstep.DroneModel.from_dict(frame() | {"mass_kg": NAN}), "data['mass_kg']")
    refuses(lambda: flockstep.DroneModel.from_dict(data), "data", error=TypeError)


@pytest.mark.parametrize("factor", ["size", "mass"])
@pytest.mark.parametrize("value", [0, -1, NAN, INF])
def test_scaled(factor, value):
    model = flockstep.DroneModel.load("x500")
    refuses(lambda: model.scaled(**{factor: value}), factor, 0, value)


def test_unknown_frames():
    refuses(lambda: flockstep.DroneModel.load("x501"), "drone", "crazyflie", "x501")
    refuses(lambda: flockstep.DroneModel.load("none.json"), "none.json")


def test_a_drone_is_placed_level_unless_an_attitude_is_given():
    batch = made(control="rotor_thrusts", physics_hz=500)
    tilted = [0.6, 0, 0.8, 0]
    for place in ({"position": [1, 2, 5]}, {"position": [[1, 2, 5]], "rows": [0]}, {"mask": [True]}):
        batch.set_pose([1, 2, 5], tilted)
        for _ in range(5):
            batch.fly([[0, 9, 0, 9]])
        assert batch.rotation[0, 2, 2] < 0.9
        position = batch.position.copy()
        batch.set_pose(**place)
        np.testing.assert_array_equal(batch.quat_wxyz, [[1, 0, 0, 0]])
        np.testing.assert_array_equal(batch.position, [[1, 2, 5]] if "position" in place else position)
        assert not batch.velocity.any() and not batch.angular_velocity.any()


def test_a_kinematic_drone_keeps_its_attitude():
    batch = placed([OPEN], [1, 2, 5], [0.6, 0, 0.8, 0])
    batch.set_pose([2, 2, 5])
    np.testing.assert_array_equal(batch.quat_wxyz, np.float32([[0.6, 0, 0.8, 0]]))


def test_one_row_places_all_drones():
    for keywords in ({}, {"motion": "rotors", "control": "velocity", "policy_hz": 50}):
        batch = flat_batch([OPEN], 3, **keywords)
        for row in (lambda values: values, lambda values: [values], lambda values: [values] * 3):
            batch.set_pose(row([1, 2, 5]), row([0.6, 0, 0, 0.8]))
            np.testing.assert_array_equal(batch.position, [[1, 2, 5]] * 3)
            np.testing.assert_array_equal(batch.quat_wxyz, np.float32([[0.6, 0, 0, 0.8]] * 3))
            batch.set_pose([0, 0, 0], rows=[1, 2])
            np.testing.assert_array_equal(batch.position, [[1, 2, 5], [0, 0, 0], [0, 0, 0]])
    batch.set_velocity([1, 0, 0])
    np.testing.assert_array_equal(batch.velocity, [[1, 0, 0]] * 3)
    for wrong in ([1, 2], [[[1, 2, 3]]], [[1, 2, 3]] * 2, []):
        refuses(lambda wrong=wrong: batch.set_pose(wrong), "position", 3, "shape")


def test_a_yaw_that_may_be_in_degrees_warns_once():
    batch = made(control="attitude")
    batch.set_pose([0, 0, 5])
    batch.fly([[9.81, 0, 0, -12]])  # an accumulated yaw
    with refused(RuntimeWarning, "command (row 0)", "yaw", 45):
        batch.fly([[9.81, 0, 0, 45]])
    batch.fly([[9.81, 0, 0, 45]])


class Attitude(flockstep.Task):
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="attitude")
    clock = flockstep.ClockConfig(policy_hz=50)

    def reset(self, batch, mask):
        batch.set_pose([0, 0, 5], mask=mask)

    def act(self, batch, actions):
        return np.tile(np.float32([9.81, 0, 0, 90]), (batch.num_drones, 1))

    def step(self, batch):
        return np.zeros(batch.num_drones), batch.contact.hit

    def observe(self, batch):
        return batch.position


def test_a_yaw_that_a_task_returns_in_degrees_warns_once():
    envs = begun(2, task=Attitude, worlds=OPEN)
    with refused(RuntimeWarning, "act", 0, 90):
        envs.step(np.zeros((2, 3), np.float32))
    envs.step(np.zeros((2, 3), np.float32))
