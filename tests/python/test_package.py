"""What `import flockstep` brings, and what it does not."""

import copy
import pickle
import runpy
import subprocess
import sys

import gymnasium
import pytest

import flockstep
from flockstep import doctor


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_exported_name_is_there():
    for name in flockstep.__all__:
        assert getattr(flockstep, name) is not None


def test_the_doctor_says_what_is_here_and_what_is_not(monkeypatch, capsys):
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


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        flockstep.nothing  # noqa: B018


def test_import_needs_neither_sb3_nor_torch_nor_gl():
    code = (
        "import sys, flockstep; "
        "print([m for m in ('torch', 'stable_baselines3', 'OpenGL', 'matplotlib', 'PIL') if m in sys.modules])"
    )
    assert run(code) == "[]"


def test_import_loads_neither_opengl_nor_what_opencv_would_bring():
    code = (
        "import flockstep; maps = open('/proc/self/maps').read(); "
        "print([name for name in ('libGL', 'libX11', 'libblas.so', 'liblapack.so', 'libopencv') if name in maps])"
    )
    assert run(code) == "[]"


def test_envs_are_registered_by_import():
    spec = gymnasium.spec("flockstep/LidarNavigation-v0")
    assert spec.vector_entry_point is not None
    assert spec.max_episode_steps == 3000


@pytest.mark.parametrize(
    "config",
    [
        flockstep.LidarConfig(beams=7, offset_m=(0.1, 0, 0)),
        flockstep.LidarConfig(azimuth_deg=[0, 10], elevation_deg=[0, -10]),
        flockstep.PoseSensorConfig(orientation_noise_std_deg=2.0),
        flockstep.NavigationReward(crash_weight=0.5),
        flockstep.NavigationConfig(action="displacement", reward=flockstep.NavigationReward(step_scale=7.0)),
    ],
)
def test_configs_can_be_copied_pickled_compared_and_read(config):
    for other in (copy.copy(config), copy.deepcopy(config), pickle.loads(pickle.dumps(config))):
        assert other == config
        assert repr(other) == repr(config)
    assert config != type(config)()
    assert repr(config).startswith(type(config).__name__)


def test_worlds_can_be_copied_into_a_spec(room):
    spec = gymnasium.make("flockstep/LidarNavigation-v0", worlds=room, lidar=flockstep.LidarConfig(beams=9)).spec
    assert spec is not None
    assert gymnasium.make(spec).observation_space.shape == (12,)


def test_version():
    assert flockstep.__version__.count(".") == 2
