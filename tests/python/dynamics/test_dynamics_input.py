"""Bad input to rotor flight: rejected with the field, the expected and the given value, before anything changes."""

import math

import numpy as np
import pytest
from gymnasium import spaces
from rigid_body import FRAMES, OPEN, batch_of, frame, plain

import flockstep

NAN, INF = math.nan, math.inf


def refused(call, match, error=ValueError):
    with pytest.raises(error, match=f"(?s){match}"):
        call()


def made(dynamics=None, clock=None, drone=None):
    """A batch of one rotor-driven drone, with some settings changed."""
    return flockstep.Batch(
        [OPEN],
        1,
        drone=drone,
        dynamics=flockstep.DynamicsConfig(**{"motion": "rotors", "control": "velocity", **(dynamics or {})}),
        clock=flockstep.ClockConfig(**{"policy_hz": 50, **(clock or {})}),
    )


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("motion", "hover", 'motion: expected "kinematic" or "rotors", got "hover"'),
        ("control", "speed", 'control: expected "pose", "rotor_speeds".*got "speed"'),
        ("integrator", "euler", 'integrator: expected "automatic", "midpoint" or "rk4", got "euler"'),
        ("on_contact", "crash", 'on_contact: expected "terminate", "stop" or "bounce", got "crash"'),
        *(("restitution", bad, r"restitution: expected a number in \[0, 1\], got") for bad in (-0.1, 1.1, NAN)),
        *(("friction", bad, r"friction: expected a number in \[0, 10\], got") for bad in (-0.1, 11, NAN)),
        *(("max_tilt_deg", bad, r"max_tilt_deg: expected a number in \(0, 89\], got") for bad in (0, 90, NAN)),
        *(
            (field, bad, f"{field}: expected a finite number > 0, got")
            for field in ("max_speed_mps", "max_acceleration_mps2", "max_rate_dps", "max_yaw_rate_dps")
            for bad in (0, -1, NAN, INF)
        ),
    ],
)
def test_dynamics_config(field, value, match):
    refused(lambda: made({field: value}), match)


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("rotor_lag", "yes", "rotor_lag: expected a bool, got 'yes'"),
        ("max_speed_mps", "5", "max_speed_mps: expected a number, got '5'"),
        ("speed", 3, "unexpected keyword argument 'speed'"),
        *(("rotor_lag", bad, "rotor_lag: expected a bool, got") for bad in (None, 2, "no", 1.0, [])),
    ],
)
def test_dynamics_config_of_wrong_types(field, value, match):
    refused(lambda: made({field: value}), match, TypeError)


def test_kinematic_motion_takes_only_poses():
    refused(lambda: made({"motion": "kinematic"}), 'control: expected "pose" .*motion="rotors".*got velocity')


@pytest.mark.parametrize(
    ("rates", "match"),
    [
        *(({"policy_hz": bad}, r"policy_hz: expected a number in \[0.001, 100000\], got") for bad in (0, -1, NAN, INF)),
        *(
            ({"physics_hz": bad}, r"physics_hz: expected a multiple of policy_hz \(50 Hz\), at most 1000 times it, got")
            for bad in (25, 75, 1e6)
        ),
        *(
            ({"physics_hz": 500} | {name: bad}, f"{name}: expected a finite number > 0, got")
            for name in ("physics_hz", "controller_hz")
            for bad in (0, -50, NAN)
        ),
        ({"policy_hz": 10, "physics_hz": 40}, "physics_hz: expected at least 50 Hz for motion by rotors.*got 40"),
        *(
            (
                {"physics_hz": 500, "controller_hz": bad},
                r"controller_hz: expected a divisor of physics_hz \(500 Hz\)",
            )
            for bad in (75, 200, 1000)
        ),
        ({"policy_hz": 0.1}, "policy_hz: expected at least 0.5 Hz for motion by rotors.*got 0.1"),
        (
            {"physics_hz": 500, "controller_hz": 125},
            r"controller_hz: expected a multiple of policy_hz \(50 Hz\), got 125 Hz",
        ),
    ],
)
def test_clock_config(rates, match):
    refused(lambda: made(clock=rates), match)


@pytest.fixture
def batch():
    batch = batch_of(frame(), 2, control="velocity")
    batch.fly([[1, 0, 0, 0], [0, 1, 0, 0]])
    return batch


def rows(values):
    """Two rows, of which the second is bad."""
    return [[0.0] * len(values), values]


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        *(
            ({"command": rows([0, bad, 0, 0])}, r"command \(row 1\): expected finite")
            for bad in (NAN, INF, -INF, 2.1e6)
        ),
        ({"command": [[0] * 4]}, r"command: expected shape \(2, 4\), got shape \(1, 4\)"),
        ({"command": [[0] * 3] * 2}, r"command: expected shape \(2, 4\), got shape \(2, 3\)"),
        ({"command": [["a"] * 4] * 2}, "command: expected an array of real numbers"),
        ({"command": None}, r"command: expected an array \(N, 4\), got None"),
        ({"command": [[0] * 4] * 2, "ticks": 0}, "ticks: expected an integer >= 1, got 0"),
        ({"command": [[0] * 4] * 2, "ticks": -1}, "ticks: expected an integer >= 1, got -1"),
        ({"command": [[0] * 4] * 2, "ticks": 10**7}, r"ticks: expected an integer in .*1000000\], got 10000000"),
        ({"command": [[0] * 4] * 2, "mask": [1, 0]}, "mask: expected an array of bool"),
        ({"command": [[0] * 4] * 2, "mask": [True]}, r"mask: expected shape \(2,\)"),
    ],
)
def test_fly(batch, arguments, match):
    before = batch.snapshot()
    refused(lambda: batch.fly(**arguments), match)
    assert batch.snapshot() == before


@pytest.mark.parametrize(
    ("control", "column", "most", "named"),
    [
        ("attitude", 1, math.pi, r"a roll within \+-pi rad \(not degrees\)"),
        ("attitude", 2, math.pi, r"a pitch within \+-pi rad \(not degrees\)"),
        *((control, 3, 1e4, r"a yaw within \+-10000 rad") for control in ("attitude", "acceleration", "position")),
    ],
)
def test_angles(control, column, most, named):
    batch = batch_of(frame(), 2, control=control)
    before = batch.snapshot()
    command = [9.81 if control == "attitude" else 0, 0, 0, 0]
    for command[column] in (45.0, -90.0) if most < 4 else (2e4, -3e4):
        match = rf"command \(row 1\): expected {named}, got {command[column]:g}"
        refused(lambda: batch.fly(rows(command)), match)
    assert batch.snapshot() == before
    command[column] = -most if most < 4 else -12
    batch.fly(rows(command))
    if most > 4:
        command[column] = -most
        with pytest.warns(RuntimeWarning, match=r"^command \(row 1\): a yaw of -10000 rad is more than two turns"):
            batch.fly(rows(command))


@pytest.mark.parametrize("control", ["rotor_speeds", "body_rates", "velocity", "heading_velocity"])
def test_invalid_angles(control):
    batch_of(frame(), 2, control=control).fly([[45.0] * 4, [2e4] * 4])


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        *(
            ({"velocity": rows([0, 0, bad])}, r"velocity \(row 1\): expected finite numbers")
            for bad in (NAN, INF, -1.1e4)
        ),
        *(
            (
                {"angular_velocity": rows([0, 0, bad])},
                r"angular_velocity \(row 1\): expected at most 1570.* rad/s, half a turn",
            )
            for bad in (NAN, INF, -1600)
        ),
        *(
            ({"rotor_speed": rows([0, 0, 0, bad])}, r"rotor_speed \(row 1\): expected numbers in \[0, 2332")
            for bad in (NAN, -1, 2333)
        ),
        ({"velocity": [[0, 0]] * 2}, r"velocity: expected shape \(2, 3\), got shape \(2, 2\)"),
        ({"rotor_speed": [[0, 0, 0]] * 2}, r"rotor_speed: expected shape \(2, 4\), got shape \(2, 3\)"),
        # A good field before a bad one is not set either.
        ({"velocity": [[1, 1, 1]] * 2, "rotor_speed": [[-1] * 4] * 2}, "rotor_speed"),
    ],
)
def test_set_velocity(batch, arguments, match):
    before = batch.snapshot()
    refused(lambda: batch.set_velocity(**arguments), match)
    assert batch.snapshot() == before


STIFF = {
    "rotor drag": lambda: frame("crazyflie", drag_n_per_radps_mps=[1e-2] * 3),
    "inertia": lambda: frame("x500", inertia_kgm2=[1e-9] * 3),
    "spin": lambda: plain("x500", inertia_kgm2=[1e-7] * 3, rotor_inertia_kgm2=1e-4),
}


@pytest.mark.parametrize("why", STIFF)
def test_an_airframe_too_stiff_for_the_tick_is_refused(why):
    refused(lambda: batch_of(STIFF[why]()), "drone: expected .* at most 1000 1/s.*physics_hz of at least")


def test_every_shipped_frame_flies_at_the_usual_tick_and_twice_of_it():
    for name in FRAMES:
        batch_of(frame(name), physics_hz=200)


def test_a_flight_that_is_lost_is_reported():
    """A tiny inertia without drag: the first thrust turns the body faster than one tick can represent."""
    batch = batch_of(plain("x500", inertia_kgm2=[1e-9] * 3), 3)
    before = batch.position.copy()
    with pytest.warns(RuntimeWarning, match=r"fly\(\): 2 drones \(first: 1\) moved faster .* half a turn in a tick"):
        batch.fly([[500] * 4, [500, 600, 500, 500], [500, 600, 500, 500]])
    assert (batch.velocity[1:] == 0).all()
    assert (batch.position[1:] == before[1:]).all()
    assert batch.velocity[0, 2] != 0
    batch.fly([[500] * 4] * 3)  # not reported again


def two(interaction, on_contact="terminate", **keywords):
    """Two drones of one env, close together; uneven thrusts turn their tiny inertia too fast at once."""
    batch = flockstep.Batch(
        [OPEN],
        2,
        drones_per_env=2,
        interaction=interaction,
        drone=flockstep.DroneModel.from_dict(plain("x500", inertia_kgm2=[1e-9] * 3)),
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="rotor_speeds", on_contact=on_contact),
        clock=flockstep.ClockConfig(policy_hz=10, physics_hz=500),
        **keywords,
    )
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
    with pytest.warns(RuntimeWarning, match=r"fly\(\): 1 drone \(first: 1\) moved faster"):
        batch.fly(ONE_SPINS, ticks=ticks)
    np.testing.assert_array_equal(batch.position[1], before[1])
    np.testing.assert_array_equal(batch.velocity[1], 0)
    assert batch.velocity[0, 2] != 0
    batch.fly([[500] * 4] * 2, ticks=3)
    assert batch.velocity[1, 2] != 0  # it flies again


def test_a_drone_that_is_stopped_before_it_is_lost_is_not_lost():
    """Alone, it would soon spin too fast. The other one hits it first, after which it stays until the next call."""

    def flown(interaction):
        drone = flockstep.DroneModel.from_dict(plain("x500", inertia_kgm2=[5e-6] * 3))
        batch = flockstep.Batch(
            [OPEN],
            2,
            drones_per_env=2,
            interaction=interaction,
            drone=drone,
            dynamics=flockstep.DynamicsConfig(motion="rotors", control="rotor_speeds"),
            clock=flockstep.ClockConfig(policy_hz=10, physics_hz=500),
        )
        batch.set_pose([[-0.4, 0, 0], [0.4, 0, 0]])
        batch.set_velocity([[60, 0, 0], [0, 0, 0]])
        batch.fly(ONE_SPINS, ticks=50)
        return batch

    with pytest.warns(RuntimeWarning, match=r"fly\(\): 1 drone \(first: 1\) moved faster"):
        flown("none")
    met = flown("collide")
    assert met.contact.hit.tolist() == [True, True]
    assert np.linalg.norm(met.position[1] - [0.4, 0, 0]) < 0.1


def test_a_lost_flight_ends_the_episode_as_a_bad_state():
    stiff = flockstep.DroneModel.from_dict(plain("x500", inertia_kgm2=[1e-9] * 3))
    envs = flockstep.DroneVectorEnv(2, task=flockstep.HoverConfig(), drone=stiff)
    envs.reset(seed=0)
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
    refused(lambda: batch.move([[0, 0, 0]] * 2), r"move\(\) is for kinematic motion.*fly\(\)", RuntimeError)
    assert batch.snapshot() == before
    kinematic = flockstep.Batch([OPEN], 1)
    before = kinematic.snapshot()
    refused(lambda: kinematic.fly([[0] * 4]), r"fly\(\) is for motion by rotors", RuntimeError)
    refused(lambda: kinematic.set_velocity([[0] * 3]), r"set_velocity\(\) is for motion by rotors", RuntimeError)
    for name in ("velocity", "angular_velocity", "acceleration", "angular_acceleration", "rotor_speed"):
        refused(lambda name=name: getattr(kinematic, name), 'motion="rotors"', AttributeError)
    assert kinematic.snapshot() == before
    refused(lambda: made({"control": "pose"}).fly([[0] * 4]), 'fly.*control="pose"', RuntimeError)


def test_a_drone_without_an_airframe_cannot_fly_by_rotors():
    hull = flockstep.DroneModel(frame()["hull_m"])
    refused(lambda: made(drone=hull), "drone: expected one with an airframe.*got only a hull")
    refused(lambda: hull.mass_kg, "only a hull", AttributeError)
    refused(lambda: hull.scaled(size=2), "drone: expected one with an airframe.*got only a hull")


LEFT_OUT = object()


@pytest.mark.parametrize(
    ("place", "value", "match"),
    [
        *(("mass_kg", bad, r"mass_kg: expected a number in \[0.0001, 10000\], got") for bad in (-1, 0, 1e5)),
        ("mass_kg", "heavy", 'mass_kg: expected a number, got "heavy"'),
        ("mass_kg", None, "mass_kg: expected a number, got null"),
        ("mass_kg", NAN, "mass_kg"),
        ("mass_kg", 4.0, "rotors: expected a thrust-to-weight above 1, to hover, got 0.866"),
        ("inertia_kgm2", [-1, 1, 1], r"inertia_kgm2\[0\]: expected a number in \[1e-12, 1000000000\], got -1"),
        ("inertia_kgm2", [1, 1, 0], r"inertia_kgm2\[2\]: expected a number in \[1e-12, 1000000000\], got 0"),
        (
            "inertia_kgm2",
            [1.43e-5, 1.43e-5, 2.89e-5],  # from a published table
            r"inertia_kgm2: expected moments.*sum of the other two, got 1.43e-05, 1.43e-05, 2.89e-05 "
            r"\(lower inertia_kgm2\[2\] to 2.86e-05, or raise the others\)",
        ),
        ("inertia_kgm2", [3, 1, 1], r"got 3, 1, 1 \(lower inertia_kgm2\[0\] to 2"),
        ("inertia_kgm2", [1, 1], "inertia_kgm2: expected an array of 3 numbers"),
        ("inertia_kgm2", 0.1, "inertia_kgm2: expected an array of 3 numbers"),
        ("rotors", [], "rotors: expected an object"),
        ("rotors/spin", ["ccw"] * 4, "rotors: expected positions and spins that can turn the body"),
        ("rotors/spin", ["ccw", "left", "cw", "cw"], 'spin/1: expected "ccw" or "cw".*got "left"'),
        ("rotors/spin", ["ccw"], 'spin: expected four of "ccw" and "cw"'),
        ("rotors/position_m", [[0, 0, 0]] * 4, "rotors: expected positions and spins that can turn the body"),
        ("rotors/position_m", [[0.1, 0.1, 0]] * 3, "position_m: expected four positions"),
        ("rotors/position_m", [[0.1, 0.1]] * 4, "position_m/0: expected an array of 3 numbers"),
        ("rotors/position_m", [[1000, 0.1, 0]] * 4, r"position_m\[0\]\[0\]: expected a number within \+-100, got 1000"),
        ("rotors/thrust_n", [0, 0, 1e-7], "rotors: expected a thrust-to-weight above 1"),
        ("rotors/thrust_n", [0, 0, -1e-6], r"thrust_n\[2\]: expected a number >= 0"),
        ("rotors/thrust_n", [0, 0, 0], "thrust_n: expected a positive thrust at full speed"),
        ("rotors/thrust_n", [1.0, -0.001, 1.6e-6], "thrust_n: expected a thrust that grows with the speed"),
        ("rotors/thrust_n", [0, 0], "thrust_n: expected an array of 3 numbers"),
        ("rotors/max_thrust_n", 8.0, 'rotors: expected either "thrust_n" or "max_thrust_n", found both'),
        ("rotors/max_speed_radps", 0, r"max_speed_radps: expected a number in \[0.001, 100000\], got 0"),
        ("rotors/min_speed_radps", -1, "min_speed_radps: expected a finite number >= 0, got -1"),
        ("rotors/min_speed_radps", 3000, "min_speed_radps: expected a number below max_speed_radps"),
        (
            "rotors/min_speed_radps",
            2000,
            "min_speed_radps: expected a speed at which the thrust is below the weight, got 2000",
        ),
        ("rotors/torque_ratio_m", 0, "torque_ratio_m: expected a number in"),
        ("rotors/lag_up_s", -0.1, r"lag_up_s: expected a number in \[0, 10\], got -0.1"),
        ("rotors/lag_down_s", 11, r"lag_down_s: expected a number in \[0, 10\], got 11"),
        ("rotors/radius_m", -1, "radius_m: expected a number in"),
        ("rotors/inertia_kgm2", -1, r"rotors inertia_kgm2: expected a number in \[0, 1000000\], got -1"),
        (
            "rotors/drag_n_per_radps_mps",
            [0, -1, 0],
            r"drag_n_per_radps_mps\[1\]: expected a number in \[0, 1000000\], got -1",
        ),
        ("rotors/lift_n_per_mps2", -1, r"lift_n_per_mps2: expected a number in \[0, 1000000\], got -1"),
        ("drag/linear_n_per_mps", [0, 0, -1], r"linear_n_per_mps\[2\]: expected a number in \[0, 1000000\], got -1"),
        ("drag/quadratic_n_per_mps2", [0, 0], "quadratic_n_per_mps2: expected an array of 3 numbers"),
        ("drag/cubic", [0, 0, 0], "drag/cubic: unknown field; expected one of linear_n_per_mps"),
        ("rotors/colour", "red", "rotors/colour: unknown field"),
        ("wings", 2, "wings: unknown field"),
        ("name", 3, "name: expected a string, got 3"),
        ("like", "x501", 'expected one of crazyflie.*got "x501"'),
        ("scaled", {"size": 2}, 'scaled: allowed only beside "like"'),
        ("flockstep_drone", 2, "flockstep_drone: expected version 1, got 2"),
        *(
            (field, LEFT_OUT, f'expected a field "{field.rpartition("/")[2]}".*found none')
            for field in (
                *("flockstep_drone", "mass_kg", "inertia_kgm2", "rotors", "rotors/position_m", "rotors/spin"),
                *("rotors/thrust_n", "rotors/max_speed_radps", "rotors/torque_ratio_m"),
            )
        ),
        ("hull_m", LEFT_OUT, 'expected a field "size_m", found none'),
        ("hull_m", [[0, 0, 0]] * 5, "hull: expected a body with a volume"),
    ],
)
def test_drone_data(place, value, match):
    data = frame()
    *groups, field = place.split("/")
    home = data[groups[0]] if groups else data
    if value is LEFT_OUT:
        del home[field]
    else:
        home[field] = value
    refused(lambda: flockstep.DroneModel.from_dict(data), match)


@pytest.mark.parametrize("data", [None, [], "x"])
def test_drone_data_of_wrong_types(data):
    refused(lambda: flockstep.DroneModel.from_dict(data), "data: dict", TypeError)


@pytest.mark.parametrize("factor", ["size", "mass"])
@pytest.mark.parametrize("value", [0, -1, NAN, INF])
def test_scaled(factor, value):
    model = flockstep.DroneModel.load("x500")
    refused(lambda: model.scaled(**{factor: value}), f"{factor}: expected a finite number > 0, got")


def test_unknown_frames():
    refused(lambda: flockstep.DroneModel.load("x501"), 'expected one of crazyflie.*path of a file.*got "x501"')
    refused(lambda: flockstep.DroneModel.load("none.json"), "none.json: cannot read a drone file")


def test_a_drone_is_placed_level_unless_an_attitude_is_given():
    batch = made({"control": "rotor_thrusts"}, {"physics_hz": 500})
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
    batch = flockstep.Batch([OPEN], 1)
    batch.set_pose([1, 2, 5], [0.6, 0, 0.8, 0])
    batch.set_pose([2, 2, 5])
    np.testing.assert_array_equal(batch.quat_wxyz, np.float32([[0.6, 0, 0.8, 0]]))


def test_one_row_places_all_drones():
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    for keywords in ({}, {"dynamics": dynamics, "clock": flockstep.ClockConfig(policy_hz=50)}):
        batch = flockstep.Batch([OPEN], 3, **keywords)
        for row in (lambda values: values, lambda values: [values], lambda values: [values] * 3):
            batch.set_pose(row([1, 2, 5]), row([0.6, 0, 0, 0.8]))
            np.testing.assert_array_equal(batch.position, [[1, 2, 5]] * 3)
            np.testing.assert_array_equal(batch.quat_wxyz, np.float32([[0.6, 0, 0, 0.8]] * 3))
            batch.set_pose([0, 0, 0], rows=[1, 2])
            np.testing.assert_array_equal(batch.position, [[1, 2, 5], [0, 0, 0], [0, 0, 0]])
    batch.set_velocity([1, 0, 0])
    np.testing.assert_array_equal(batch.velocity, [[1, 0, 0]] * 3)
    for wrong in ([1, 2], [[[1, 2, 3]]], [[1, 2, 3]] * 2, []):
        refused(lambda wrong=wrong: batch.set_pose(wrong), r"position: expected shape \(3, 3\), got shape")


def test_a_yaw_that_may_be_in_degrees_warns_once():
    batch = made({"control": "attitude"})
    batch.set_pose([0, 0, 5])
    batch.fly([[9.81, 0, 0, -12]])  # an accumulated yaw
    said = r"^command \(row 0\): a yaw of 45 rad is more than two turns: is it in degrees\?$"
    with pytest.warns(RuntimeWarning, match=said):
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
    envs = flockstep.DroneVectorEnv(2, task=Attitude, worlds=OPEN)
    envs.reset(seed=0)
    with pytest.warns(RuntimeWarning, match=r"^act: command \(row 0\): a yaw of 90 rad is more than two turns"):
        envs.step(np.zeros((2, 3), np.float32))
    envs.step(np.zeros((2, 3), np.float32))
