"""Logs that cannot be used are refused, with file, column and what came."""

import os
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from conftest import WITHOUT
from flight_logs import GUESS, crazyflie_bytes, csv_text, fly_logs
from messages import refused

import flockstep
from flockstep.identification import (
    Table,
    drone_data,
    fit,
    flights_of,
    linear_map,
    predict,
    read_flights,
    read_table,
)


@pytest.fixture(scope="module")
def columns():
    return fly_logs(1, 5.0, hz=100)[0]


def write(path, columns):
    path.write_text(csv_text(columns))
    return path


def without(columns, *names):
    return {name: values for name, values in columns.items() if name not in names}


def changed(columns, name, row, value):
    values = columns[name].copy()
    values[row] = value
    return columns | {name: values}


#: What is wrong, by the change that makes it so, with the column of the message and values in it.
CASES = {
    "no time": (lambda c: without(c, "time_s"), "time_s"),
    "no motors": (lambda c: without(c, *(f"motor_{k}" for k in (1, 2, 3, 4))), "motor_1"),
    "a motor missing": (lambda c: without(c, "motor_3"), "motor_1", 4, 2),
    "no accelerometer": (lambda c: without(c, *(f"accelerometer_{a}_mps2" for a in "xyz")), "accelerometer_z_mps2"),
    "nan": (lambda c: changed(c, "gyro_y_radps", 7, np.nan), "gyro_y_radps", "nan", 8),
    "infinite": (lambda c: changed(c, "motor_2", 0, np.inf), "motor_2", "inf", 1),
    "command too large": (lambda c: changed(c, "motor_2", 5, 1.5), "motor_2", 1.5),
    "negative command": (lambda c: changed(c, "motor_1", 5, -0.5), "motor_1", -0.5),
    "huge": (lambda c: changed(c, "accelerometer_z_mps2", 5, 1e300), "accelerometer_z_mps2", "1e+300"),
    "uneven": (lambda c: c | {"time_s": np.repeat(np.arange(250) * 0.09, 2) + np.tile([0, 1e-6], 250)}, "time_s"),
    "time goes back": (lambda c: changed(c, "time_s", 9, 3.0), "time_s"),
    "constant motor": (lambda c: c | {"motor_4": 0 * c["motor_4"] + 0.5}, "motor_4", 0.5),
    "short": (lambda c: {name: values[:150] for name, values in c.items()}, "time_s", 2, 1.49),
    "short flight": (lambda c: {name: values[:350] for name, values in c.items()}, "flight", 2),
    "slow": (lambda c: {name: values[::5] for name, values in c.items()}, "time_s", 50, 20),
    "one row": (lambda c: {name: values[:1] for name, values in c.items()}, "time_s", 2, 0),
    "no rows": (lambda c: {name: values[:0] for name, values in c.items()}, "time_s", 2, 0),
    "motors off": (lambda c: c | {f"motor_{k}": 1e-5 * c[f"motor_{k}"] for k in (1, 2, 3, 4)}, "flight", 2),
    "duties without battery": (lambda c: {n.replace("motor", "duty"): v for n, v in c.items()}, "battery_v"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_csv_file_is_refused(case, columns, tmp_path):
    change, field, *values = CASES[case]
    path = write(tmp_path / "bad.csv", change(dict(columns)))
    with refused(ValueError, field, path, *values):
        read_flights([path])


@pytest.mark.parametrize(
    ("text", "field", "values"),
    [
        ("", "flight log", []),
        ("hello", "time_s", ["hello"]),
        ("time_s,motor_1\n1,2,3\n", "line 2", [2, 3]),
        ("time_s,motor_1\n1,2\n2,abc\n", "motor_1", ["line 3", "abc"]),
        ("time_s,time_s\n1,2\n", "time_s", [2]),
        ('time_s,motor_1\n1,"2\n', "bad.csv", []),
        ("time_s,motr_1,acc.z\n1,2,3\n", "motor_1", []),
    ],
)
def test_a_bad_line_is_refused(text, field, values, tmp_path):
    (tmp_path / "bad.csv").write_text(text)
    with refused(ValueError, field, *values):
        read_flights([tmp_path / "bad.csv"])


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "bad").write_bytes(b"\x89PNG\xff\xfe")
    with refused(ValueError, "CSV file"):
        read_table(tmp_path / "bad")


def with_checksum(data):
    return data + struct.pack("<I", zlib.crc32(data))


def test_damaged_crazyflie_logs_are_refused(columns, tmp_path):
    """Cut anywhere, a byte changed, or wrong inside in spite of a right checksum."""
    data = crazyflie_bytes(columns)
    path = tmp_path / "log00"
    flipped = bytearray(data)
    flipped[5000] ^= 1
    for bad in (data[:1], data[:8], data[:300], data[:-1], data[: len(data) // 2], bytes(flipped)):
        path.write_bytes(bad)
        with refused(ValueError, "checksum"):
            read_table(path)
    body = data[:-4]
    version = bytearray(body)
    version[1] = 1
    for bad, field, *values in (
        (version, "version", 2, 1),
        (body[:60], "columns", 2),
        (body[:-7], "record"),
        (body.replace(b"gyro.x(f)", b"gyro.x(?)"), "column", "gyro.x(?)"),
    ):
        path.write_bytes(with_checksum(bytes(bad)))
        with refused(ValueError, field, *values):
            read_table(path)


def test_random_bytes_never_crash_the_reader(columns, tmp_path):
    """A reader of files from outside raises ValueError, and nothing else."""
    random = np.random.default_rng(0)
    body = crazyflie_bytes(columns)[:-4][:4000]
    path = tmp_path / "log00"
    for _ in range(300):
        bad = bytearray(body)
        for at in random.integers(1, 400, 5):
            bad[at] = random.integers(256)
        path.write_bytes(with_checksum(bytes(bad[: random.integers(5, 4000)])))
        try:
            read_flights([path])
        except ValueError as error:
            assert str(path) in str(error)  # noqa: PT017 # most are refused, some only differ


def test_bad_arguments_are_refused(columns, tmp_path):
    path = write(tmp_path / "log.csv", columns)
    with refused(ValueError, "keep", "lag"):
        fit([path], keep=["lag"])
    with refused(ValueError, "logs"):
        fit([])
    with refused(ValueError, "logs"):  # too short for so many numbers
        fit([path])
    with refused(ValueError, "like"):
        fit([path], flockstep.DroneModel(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])))
    with refused(ValueError, "flight", 2):
        read_flights([f"{path}@4-5"])
    with pytest.raises(OSError, match="nothing"):
        read_flights([tmp_path / "nothing.csv"])


@pytest.mark.parametrize(
    ("keywords", "field"),
    [
        ({"horizons_s": ()}, "horizons_s"),
        ({"horizons_s": (0.1, float("nan"))}, "horizons_s"),
        ({"horizons_s": (1e9,)}, "horizons_s"),
        ({"horizons_s": (0.1,), "trim_s": -1.0}, "trim_s"),
        ({"horizons_s": (0.1,), "delay_s": float("nan")}, "delay_s"),
        ({"horizons_s": (9.0,)}, "flights"),
    ],
)
def test_bad_predictions_are_refused(keywords, field, columns):
    flights, drone = flights_of(Table("flight", columns), 4), flockstep.DroneModel.load("crazyflie")
    with refused(ValueError, field):
        predict(flights, drone, linear_map(drone), **keywords)


def test_flights_with_unlike_columns_are_not_predicted_together(columns):
    less = {name: values for name, values in columns.items() if not name.startswith("velocity")}
    flights = [flights_of(Table("flight", each), 4)[0] for each in (columns, less)]
    drone = flockstep.DroneModel.load("crazyflie")
    with refused(ValueError, "flights"):
        predict(flights, drone, linear_map(drone), (0.1,))


def test_a_bad_mass_is_refused():
    (flown,) = fly_logs(1, 20.0, hz=100)
    found = fit(flights_of(Table("flight", flown), 4), flockstep.DroneModel.from_dict(GUESS))
    for mass in (0.0, -1.0, float("nan"), float("inf"), True):
        with refused(ValueError, "mass_kg", mass):
            drone_data(found, mass_kg=mass)


def run(*arguments, begin="", **options):
    program = f"{begin}\nimport runpy, sys\nsys.argv = ['flockstep', *{arguments!r}]\nrunpy.run_module('flockstep')"
    program = program.replace("run_module('flockstep')", "run_module('flockstep', run_name='__main__')")
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, **options)


def test_the_command_writes_drone_report_and_plots(tmp_path):
    flown = fly_logs(2, 20.0, hz=100)
    log, other = (write(tmp_path / f"log{k}.csv", each) for k, each in enumerate(flown))
    done = run("identify", str(log), "--held-out", str(other), "--mass-kg", "0.03", "--out", "my.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "| motor lag |" in done.stdout
    assert "Held out: log1.csv, flight 1" in done.stdout
    assert flockstep.DroneModel.load(tmp_path / "my.json").name == "my"
    assert "![Logs and model](my.png)" in (tmp_path / "my.md").read_text()
    assert (tmp_path / "my.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("package", ["scipy", "matplotlib"])
def test_the_command_says_what_is_missing(package, tmp_path):
    done = run("identify", "log.csv", begin=WITHOUT.format(names=[package]), cwd=tmp_path)
    assert done.returncode == 1
    assert f"identify needs {package}, which is not installed: pip install scipy matplotlib" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nothing.csv"], "nothing.csv"),
        (["bad.csv"], "identify: bad.csv: expected"),
        (["bad.csv", "--out", "drone.txt"], "--out: expected a name that ends with .json, got 'drone.txt'"),
        (["bad.csv", "--like", "crazyfly"], "crazyfly"),
    ],
)
def test_the_command_says_what_is_wrong(arguments, told, tmp_path):
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    done = run("identify", *arguments, cwd=tmp_path)
    assert done.returncode == 1
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert os.listdir(tmp_path) == ["bad.csv"]
