"""Contents of `import flockstep`, and modules that it must not import."""

import copy
import os
import pickle
import re
import runpy
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from conftest import WITHOUT
from messages import refused

import flockstep
from flockstep import doctor


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_doctor_reports_available_and_missing_parts(monkeypatch, capsys):
    lines = dict(line.split("  ", 1) for line in run("from flockstep import doctor; doctor.main()").splitlines())
    assert lines["flockstep"].strip().startswith(flockstep.__version__)
    assert "Embree" in lines["camera backend raycast"]
    assert doctor.version_of("no-such-package") is None
    monkeypatch.setattr(doctor, "version_of", lambda package: None)
    monkeypatch.setenv("FLOCKSTEP_EGL", "none")
    monkeypatch.setattr("sys.argv", ["flockstep", "doctor"])
    runpy.run_module("flockstep", run_name="__main__")
    printed = capsys.readouterr().out
    assert "missing (neural networks for training): pip install torch" in printed
    assert "EGL is switched off by FLOCKSTEP_EGL=none" in printed


def test_output_that_cannot_be_written_is_an_error_in_one_line():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "flockstep", "doctor"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("flockstep: cannot write the output: ")


@pytest.mark.parametrize("missing", ["numpy", "gymnasium"])
def test_the_doctor_runs_without_required_packages(missing, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(WITHOUT.format(names=[missing]))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    doctored, imported = (
        subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=environment, check=False)
        for arguments in (["-m", "flockstep", "doctor"], ["-c", "import flockstep"])
    )
    assert (doctored.returncode, doctored.stderr) == (1, "")
    (line,) = (line for line in doctored.stdout.splitlines() if line.startswith(missing))
    assert f"importing it raises ModuleNotFoundError: No module named '{missing}'" in line
    assert "ModuleNotFoundError" in imported.stderr


def test_the_doctor_imports_what_it_names(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)  # makes an import of it raise
    found = dict(doctor.report())
    assert "importing it raises ModuleNotFoundError: import of torch halted" in found["torch"]
    assert "pip install --force-reinstall torch" in found["torch"]
    assert found["scipy"] == doctor.version_of("scipy")


@pytest.mark.parametrize(
    ("attribute", "missing", "extra"),
    [
        ("sb3", "stable_baselines3", "sb3"),
        ("connect", "google", "client"),
        ("connect", "websockets", "client"),
        ("rllib", "ray", "rllib"),
        ("torch", "torch", "sb3"),
    ],
)
def test_what_needs_an_extra_names_it(attribute, missing, extra):
    code = (
        f"import flockstep\ntry:\n    flockstep.{attribute}\nexcept ImportError as error:\n    print(error, error.name)"
    )
    printed = run(WITHOUT.format(names=[missing]) + code)
    assert f"pip install 'flockstep[{extra}]'" in printed
    assert missing in printed.rpartition(" ")[2]


def test_names_that_dir_lists():
    listed = run("import flockstep; print(*dir(flockstep))").split()
    public = [name for name in listed if not name.startswith("__")]
    assert sorted([*public, "__version__"]) == sorted(flockstep.__all__)
    assert {"client", "connect", "rllib", "sb3", "testing"} < set(public)
    for name in set(flockstep.__all__) - {"rllib"}:  # Ray needs a separate environment: tests/ray/
        assert getattr(flockstep, name) is not None
    assert flockstep.__version__.count(".") == 2
    with refused(AttributeError, "no attribute 'nothing'"):
        flockstep.nothing  # noqa: B018


def test_import_loads_neither_optional_packages_nor_opengl_nor_what_opencv_would_bring():
    optional = ("torch", "stable_baselines3", "OpenGL", "matplotlib", "PIL", "google.protobuf", "websockets", "ray")
    libraries = ("libGL", "libX11", "libblas.so", "liblapack.so", "libopencv")
    code = f"""
import sys, flockstep
maps = open('/proc/self/maps').read()
print([name for name in {optional} if name in sys.modules] + [name for name in {libraries} if name in maps])
"""
    assert run(code) == "[]"


def test_envs_are_registered_by_import():
    spec = gymnasium.spec("flockstep/LidarNavigation-v0")
    assert spec.vector_entry_point is not None
    assert spec.max_episode_steps == 3000


@pytest.mark.parametrize(
    "config",
    [
        flockstep.LidarConfig(azimuth_deg=[0, 10], elevation_deg=[0, -10], offset_m=(0.1, 0, 0)),
        flockstep.PoseSensorConfig(orientation_noise_std_deg=2.0),
        flockstep.RaceConfig(laps=5, start="gate"),
        flockstep.TrackConfig(path="random", yaw="along"),
        flockstep.NavigationConfig(action="displacement", reward=flockstep.NavigationReward(step_scale=7.0)),
    ],
)
def test_configs_can_be_copied_pickled_compared_and_read(config):
    for other in (copy.copy(config), copy.deepcopy(config), pickle.loads(pickle.dumps(config))):
        assert other == config
        assert repr(other) == repr(config)
    assert config != type(config)()
    assert repr(config).startswith(type(config).__name__)


@pytest.mark.parametrize("kind", [getattr(flockstep, name) for name in flockstep.__all__ if name.endswith("Config")])
def test_configs_print_the_shortest_numbers(kind):
    config = kind()
    assert not re.search(r"\d\.\d{9}", repr(config))
    made = eval(repr(config), vars(flockstep))
    assert made == config


def test_configs_print_numbers_that_give_the_same_config():
    rng = np.random.default_rng(0)
    for bits in rng.integers(1, 0x7F7FFFFF, 300, dtype=np.uint32):
        value = float(bits.view(np.float32))
        config = flockstep.HoverConfig(near_weight=value, speed_weight=-value)
        assert eval(repr(config), vars(flockstep)) == config
        (printed,) = re.findall(r"near_weight=([^,]*)", repr(config))
        if value < 1e7:  # larger values are integers, printed with all digits
            assert float(printed) == float(str(np.float32(value)))  # NumPy also prints the shortest form
    assert "hold_m=0.05," in repr(flockstep.HoverConfig())
    assert "offset_m=[0.1, 0.0, 0.0]" in repr(flockstep.LidarConfig(offset_m=(0.1, 0, 0)))
    assert "rate_hz=0.3" in repr(flockstep.LidarConfig(rate_hz=0.3))
    assert "azimuth_deg=[0.1, 0.2]" in repr(flockstep.LidarConfig(azimuth_deg=[0.1, 0.2], elevation_deg=[0, 0]))
    assert "NavigationReward(" in repr(flockstep.NavigationConfig())


def test_batches_contacts_and_specs_say_what_they_are(room):
    lidar, cameras = flockstep.LidarConfig(beams=7), [flockstep.CameraConfig(width_px=4, height_px=4)]
    batch = flockstep.Batch(room, 3, lidar=lidar, cameras=cameras)
    assert repr(batch) == '<Batch: 3 drones in 1 world, motion "kinematic", a LiDAR of 7 rays, 1 camera, no task>'
    moved = batch.move(batch.position + np.float32([[0, 0, 0], [9, 0, 0], [9, 0, 0]]))
    assert repr(moved) == "<Contact: 2 of 3 drones hit something>"
    pool = flockstep.WorldPool(lambda number: room)
    assert "in worlds of a WorldPool" in repr(flockstep.DroneVectorEnv(1, worlds=pool).batch)
    assert repr(flockstep.DroneVectorEnv(1, worlds=room).batch.spec) == (
        "TaskSpec(action=<Field 'action': int64 (), low 0.0, high 5.0>, "
        "observation=[<Field 'observation': float32 (38,), low -1.0 to 0.0, high 1.0>], "
        "reward_terms=['distance', 'crash', 'free_space', 'step', 'action_change', 'overshoot'])"
    )


def test_worlds_can_be_copied_into_a_spec(room):
    spec = gymnasium.make("flockstep/LidarNavigation-v0", worlds=room, lidar=flockstep.LidarConfig(beams=9)).spec
    assert spec is not None
    assert gymnasium.make(spec).observation_space.shape == (12,)
