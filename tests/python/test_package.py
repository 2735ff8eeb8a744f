"""What `import swiftlet` brings, and what it does not."""

import subprocess
import sys

import gymnasium
import pytest

import swiftlet


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_exported_name_is_there():
    for name in swiftlet.__all__:
        assert getattr(swiftlet, name) is not None


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        swiftlet.nothing  # noqa: B018


def test_import_needs_neither_sb3_nor_torch_nor_gl():
    code = (
        "import sys, swiftlet; "
        "print([m for m in ('torch', 'stable_baselines3', 'OpenGL', 'matplotlib', 'PIL') if m in sys.modules])"
    )
    assert run(code) == "[]"


def test_envs_are_registered_by_import():
    spec = gymnasium.spec("swiftlet/LidarNavigation-v0")
    assert spec.vector_entry_point is not None
    assert spec.max_episode_steps is None  # the engine counts


def test_version():
    assert swiftlet.__version__.count(".") == 2
