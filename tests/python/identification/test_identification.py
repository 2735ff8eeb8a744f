"""Drones from flight logs: the numbers of drones that the engine flew come back, within their intervals.

THIRD_PARTY.md lists the extracts of logs of real Crazyflies. `./dev bench reality` fits and predicts whole ones.
"""

import json
import warnings

import numpy as np
import pytest
from conftest import ROOT
from flight_logs import GUESS, OPEN, TRIM, TRUTH, crazyflie_bytes, csv_text, fly_logs

import flockstep
from flockstep.identification import drone_data, fit, flights_of, linear_map, predict, read_flights, report, thrust_map
from flockstep.identification.model import frame_of, parameters_of
from flockstep.identification.reading import Table
from flockstep.rotations import rotate, rpy_from_quat

SECONDS, DELAY_TICKS = 25.0, 2
REAL_LOGS = ROOT / "tests" / "python" / "identification" / "logs"
GUESSED = flockstep.DroneModel.from_dict(GUESS)
TRUE = flockstep.DroneModel.from_dict(TRUTH)


def truth():
    """The true parameters, with trim by the motors' gains."""
    modes = frame_of(TRUE).modes
    trims = np.linalg.lstsq(modes, TRIM - 1, rcond=None)[0]
    offsets = {"delay_s": DELAY_TICKS / 500, "bias_x": 0.1, "bias_y": -0.1}
    named = dict(zip(("trim_roll", "trim_pitch", "trim_yaw"), trims, strict=True)) | offsets
    return parameters_of(TRUE).changed(list(named), np.array(list(named.values())))


@pytest.fixture(scope="module")
def logs():
    """Columns of three flights."""
    return fly_logs(3, SECONDS, delay_ticks=DELAY_TICKS)


@pytest.fixture(scope="module")
def fits(logs):
    return [fit(flights_of(Table("flight", columns), 4), GUESSED) for columns in logs]


def test_numbers_come_back(fits):
    """Every number lies within twice its interval, and nearly all in it: 95 % are expected."""
    inside = []
    for found in fits:
        assert not found.warnings
        for name, half in found.half_widths.items():
            if name.startswith("thrust_"):
                continue  # these depend on each other: below
            off = abs(getattr(found.parameters, name) - getattr(truth(), name))
            assert off <= 2 * half, f"{name}: {off} from the truth, expected at most twice {half}"
            inside.append(off <= half)
        for command, value, half in found.thrust:
            exact = 4 * float(truth().thrust(np.array(command))) / 9.81
            assert abs(value - exact) <= 2 * half
            inside.append(abs(value - exact) <= half)
    assert np.mean(inside) >= 0.85


def test_intervals_are_small(fits):
    """The flights determine everything: half an interval is at most five percent of its number."""
    for found in fits:
        for name in ("lag_s", "inertia_x", "inertia_y", "torque_ratio", "spin", "drag_x", "drag_y", "drag_z"):
            assert found.half_widths[name] <= 0.05 * getattr(truth(), name), name
        assert min(found.r2.values()) > 0.98


def test_six_rotors_under_the_engines_controller():
    """A hexarotor whose rotors follow at once, so that the logged speeds are the commands."""
    drone = flockstep.DroneModel.load("f550")
    data = drone.to_dict()
    batch = flockstep.Batch(
        [OPEN],
        1,
        drone=drone,
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="body_rates", rotor_lag=False),
        clock=flockstep.ClockConfig(policy_hz=250, physics_hz=250),
    )
    batch.set_pose([0, 0, 0])
    random = np.random.default_rng(0)
    rows = []
    for goal in np.repeat(random.uniform(-1, 1, (100, 4)), 50, axis=0):
        quat, velocity = np.array(batch.quat_wxyz, float), np.array(batch.velocity, float)
        rates = np.array(batch.angular_velocity[0], float)
        turn = -3 * rpy_from_quat(quat)[0] + goal[:3] * [1.2, 1.2, 0.8]
        batch.fly(np.array([[9.81 + 2 * goal[3], *turn]], np.float32))
        change = (np.array(batch.velocity, float) - velocity) * 250
        force = rotate(quat, change + np.array([0, 0, 9.81]), inverse=True)[0]
        command = batch.rotor_speed[0] / data["rotors"]["max_speed_radps"]
        rows.append([*command, *rates, *force] + 0.02 * random.standard_normal(12) * ([0] * 6 + [1] * 6))
    names = [f"motor_{k + 1}" for k in range(6)]
    names += [
        f"{kind}_{axis}_{unit}" for kind, unit in (("gyro", "radps"), ("accelerometer", "mps2")) for axis in "xyz"
    ]
    columns = {"time_s": np.arange(len(rows)) / 250} | dict(zip(names, np.transpose(rows), strict=True))
    changes = {"inertia_kgm2": [1.4 * each for each in data["inertia_kgm2"]], "rotors": {"torque_ratio_m": 0.03}}
    guessed = flockstep.DroneModel.from_dict({"flockstep_drone": 1, "like": "f550"} | changes)
    found, true = fit(flights_of(Table("hexarotor", columns), 6), guessed).parameters, parameters_of(drone)
    for name in ("inertia_x", "inertia_y", "torque_ratio"):
        assert getattr(found, name) == pytest.approx(getattr(true, name), rel=0.05), name
    assert found.thrust(np.array(0.5)) == pytest.approx(true.thrust(np.array(0.5)), rel=0.02)
    assert found.lag_s < 0.004


def test_both_formats_give_the_same(logs, tmp_path):
    """A Crazyflie's file has whole commands and 32-bit numbers, so it differs by a little."""
    columns = {name: values for name, values in logs[0].items() if name.startswith(("time", "motor", "gyro", "acc"))}
    (tmp_path / "log.csv").write_text(csv_text(columns))
    (tmp_path / "log00").write_bytes(crazyflie_bytes(columns))
    found = [fit([tmp_path / name], GUESSED, keep=["drag_x", "drag_y", "drag_z"]) for name in ("log.csv", "log00")]
    for name, half in found[0].half_widths.items():
        assert getattr(found[1].parameters, name) == pytest.approx(getattr(found[0].parameters, name), abs=half / 10)


@pytest.mark.parametrize(
    ("still", "noise", "names"),
    [
        (0, 15.0, {"inertia_x"}),
        (2, 15.0, {"torque_ratio", "spin"}),
        (3, 1.0, {"thrust curve"}),
    ],
)
def test_an_axis_that_is_not_shaken_keeps_its_numbers_and_warns(still, noise, names):
    shaken = [1, 1, 1, 1]
    shaken[still] = 0
    (columns,) = fly_logs(1, SECONDS, shaken=shaken, noise=noise, hz=250)
    found = fit(flights_of(Table("flight", columns), 4), GUESSED)
    assert {warning.partition(":")[0] for warning in found.warnings} >= names
    for name in names - {"thrust curve"}:
        assert name not in found.half_widths
        assert getattr(found.parameters, name) == getattr(parameters_of(GUESSED), name)
    assert found.half_widths["inertia_y"] < 0.2 * found.parameters.inertia_y
    assert ("thrust_scale" in found.half_widths) == ("thrust_2" not in found.half_widths) == ("thrust curve" in names)
    assert "**Warning**" in report(found)


def test_numbers_without_any_effect_are_not_determined(logs):
    """A log whose velocity is always 0 says nothing about drag."""
    still = {name: 0 * values if name.startswith("velocity") else values for name, values in logs[0].items()}
    found = fit(flights_of(Table("flight", still), 4), GUESSED)
    assert {"drag_x", "drag_y", "drag_z"} <= {warning.partition(":")[0] for warning in found.warnings}
    assert "drag_x" not in found.half_widths


def test_the_drone_file_loads_and_flies(fits, tmp_path):
    data = drone_data(fits[0], mass_kg=0.03, name="found")
    (tmp_path / "found.json").write_text(json.dumps(data))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drone = flockstep.DroneModel.load(tmp_path / "found.json")
    assert drone.thrust_to_weight == pytest.approx(TRUE.thrust_to_weight, rel=0.01)
    found, true = drone.to_dict(), TRUE.to_dict()
    assert found["inertia_kgm2"] == pytest.approx(true["inertia_kgm2"], rel=0.02)
    assert found["drag"]["linear_n_per_mps"] == pytest.approx(true["drag"]["linear_n_per_mps"], rel=0.05)
    envs = flockstep.DroneVectorEnv(4, worlds="train", drone=drone, motion="rotors", action="displacement")
    start = envs.reset(seed=0)
    assert start
    for _ in range(20):
        *_, terminated, _, _ = envs.step(np.zeros((4, 3), np.float32))
        assert not terminated.any()
    envs.close()


@pytest.mark.parametrize("has_position", [True, False])
def test_the_true_drone_predicts_its_own_flight(has_position, fits):
    (columns,) = fly_logs(1, 12.0, noise=0.0)
    if not has_position:
        columns = {name: v for name, v in columns.items() if not name.startswith(("position", "velocity", "roll"))}
    flights = flights_of(Table("flight", columns), 4)
    to_speed = linear_map(TRUE, fits[0])
    true, guessed = (predict(flights, drone, to_speed, (0.1, 0.3)) for drone in (TRUE, GUESSED))
    assert true.segments == guessed.segments > 20
    for quantity, errors in true.of_model.items():
        for horizon, error in errors.items():
            assert error < 0.15 * true.of_guess[quantity][horizon], (quantity, horizon)
            assert error < 0.5 * guessed.of_model[quantity][horizon], (quantity, horizon)


def test_a_prediction_repeats():
    flights = flights_of(Table("flight", fly_logs(1, 6.0)[0]), 4)
    once = predict(flights, TRUE, linear_map(TRUE), (0.2,))
    assert predict(flights, TRUE, linear_map(TRUE), (0.2,)) == once


def test_trim_removes_the_mean_torque():
    """With motors of unlike strength, a drone that is trimmed by the second before turns less in calm flight."""
    (columns,) = fly_logs(1, 8.0, shaken=(0, 0, 0, 0), noise=0.0)
    flights = flights_of(Table("flight", columns), 4)
    plain, trimmed = (predict(flights, TRUE, linear_map(TRUE), (0.3,), trim_s=time) for time in (0.0, 1.0))
    assert trimmed.of_model["roll"][0.3] < 0.1 * plain.of_model["roll"][0.3]


def test_thrust_map_makes_thrusts_of_commands():
    command = np.array([0.1, 0.5, 1.0])
    c0, c1, c2 = TRUE.to_dict()["rotors"]["thrust_n"]
    speed = thrust_map(TRUE)(command)
    assert c0 + c1 * speed + c2 * speed**2 == pytest.approx(command * TRUE.max_thrust_n)


def test_duties_act_times_the_voltage(logs):
    """A log of duty cycles and a falling battery gives what the commands give."""
    columns = {name: values for name, values in logs[0].items() if not name.startswith("motor")}
    battery = np.linspace(4.1, 3.3, len(columns["time_s"]))
    for k in range(4):
        columns[f"duty_{k + 1}"] = np.minimum(logs[0][f"motor_{k + 1}"] * 4.2 / battery, 1.0)
    (flight,) = flights_of(Table("flight", columns | {"battery_v": battery}), 4)
    (told,) = flights_of(Table("flight", logs[0]), 4)
    assert flight.command == pytest.approx(told.command, abs=1e-9)


def test_spans_choose_seconds(logs, tmp_path):
    (tmp_path / "log.csv").write_text(csv_text(logs[0]))
    (flight,) = read_flights([f"{tmp_path / 'log.csv'}@10-15"])
    free = flight.time_s[flight.free]
    assert 10 <= free[0] < 10.01
    assert 14.99 < free[-1] <= 15
    assert flight.time_s[0] == 3.0  # the rotors' speeds depend on what was before


def test_thrust_answers_faster_than_the_bundled_lag():
    """Nine seconds of a real log, climbs and falls, of which the first and the last are left out."""
    (flight,) = read_flights([REAL_LOGS / "sysid_log10"])
    assert flight.dt_s == pytest.approx(0.99e-3, abs=3e-6)
    assert flight.duration_s == pytest.approx(7.0, abs=0.1)
    assert np.mean(flight.specific_force[flight.free, 2]) == pytest.approx(9.8, abs=0.5)
    explained = {}
    for lag_ms in (72, 145):
        data = {"flockstep_drone": 1, "like": "crazyflie", "rotors": {"lag_s": lag_ms / 1e3}}
        drone = flockstep.DroneModel.from_dict(data)
        thrust = fit([flight._replace(gyro=None)], drone, keep=["lag_s", "delay_s"])
        explained[lag_ms] = thrust.r2["thrust"]
        assert any(warning.startswith("drag_z: not determined (no log has velocity") for warning in thrust.warnings)
    assert explained[72] > 0.95
    assert explained[145] < 0.9


def test_calm_flight_determines_trim_and_thrust_only():
    """Two hops of a real log without gyroscope and pitch, whose attitude and rates are estimated."""
    flights = read_flights([REAL_LOGS / "crazypad_E8_log00"])
    assert [round(flight.duration_s, 1) for flight in flights] == [6.6, 7.2]
    for flight in flights:
        assert flight.is_estimated
        assert np.abs(flight.attitude[flight.free]).max() < 0.3
        # The estimated pitch leans into the acceleration: forward at first, or back.
        assert np.std(flight.attitude[flight.free, 1]) == pytest.approx(0.03, abs=0.01)
    found = fit(flights)
    assert {"thrust_scale", "trim_roll", "trim_pitch", "trim_yaw"} <= found.half_widths.keys()
    kept = {warning.partition(":")[0] for warning in found.warnings}
    assert {"inertia_x", "inertia_y", "torque_ratio", "lag_s", "thrust curve"} <= kept
    # It flies at up to 0.7 m/s along x, but its pitch was not logged; vertical drag is within its own size.
    assert {"drag_x", "drag_y", "drag_z"} <= kept
    assert "drag_x: not determined (no log has an accelerometer, velocity and all three angles)" in report(found)
    assert not {"drag_x", "drag_y", "drag_z"} & found.half_widths.keys()
    drone = flockstep.DroneModel.from_dict(drone_data(found))
    errors = predict(flights, drone, linear_map(drone), (0.1,), trim_s=1.0)
    assert errors.of_model["position"][0.1] < 0.01
