"""Extracts of logs of real Crazyflies, listed in THIRD_PARTY.md. `./dev bench reality` fits and predicts whole ones."""

import numpy as np
import pytest
from conftest import ROOT

import flockstep
from flockstep.identification import drone_data, fit, linear_map, predict, read_flights, report

LOGS = ROOT / "tests" / "python" / "identification" / "logs"


def test_thrust_answers_faster_than_the_bundled_lag():
    """Nine seconds of climbs and falls, of which the first and the last are left out."""
    (flight,) = read_flights([LOGS / "sysid_log10"])
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
    """Two hops of a log without gyroscope and pitch, whose attitude and rates are estimated."""
    flights = read_flights([LOGS / "crazypad_E8_log00"])
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
