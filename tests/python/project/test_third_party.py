"""THIRD_PARTY.md lists every library in a wheel."""

import importlib.util
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT
from messages import refused

from flockstep import _core

SYSTEM = re.compile(r"lib(c|m|dl|z|gcc_s|stdc\+\+)\.so")  # on every Linux: no wheel contains them


@pytest.fixture(scope="module")
def wheel():
    spec = importlib.util.spec_from_file_location("wheel_program", ROOT / "packaging" / "wheel.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_is_compiled_in_is_listed(wheel):
    text = (ROOT / "THIRD_PARTY.md").read_text()
    assert "libopencv-core-dev" in wheel.COMPILED_IN
    for package in wheel.COMPILED_IN:
        assert f"`{package}`" in text


def test_what_the_module_loads_is_listed(wheel):
    if shutil.which("dpkg-query") is None:
        return  # packages have Debian's names
    text = (ROOT / "THIRD_PARTY.md").read_text()
    loaded = subprocess.run(["ldd", _core.__file__], capture_output=True, text=True, check=True).stdout
    paths = [Path(path) for path in re.findall(r"=> (/\S+)", loaded)]
    packages = {wheel.package_of(path)[0] for path in paths if not SYSTEM.match(path.name)}
    assert "libtbb12" in packages
    for package in packages:
        assert f"`{package}`" in text
    shared = [set(re.findall(r"`([^`]+)`", row)) for row in re.findall(r"\| shared.*", text)]
    assert len(shared) > 5
    assert all(names & packages for names in shared), "THIRD_PARTY.md lists a shared library that is not loaded"


def test_a_wheel_with_what_opencv_would_bring_is_refused(wheel, tmp_path, monkeypatch):
    def made(*libraries):
        licence = "flockstep-0.1.0.dist-info/licenses/third_party/libopencv-core-dev.txt"
        with zipfile.ZipFile(tmp_path / "made.whl", "w") as archive:
            for name in ("flockstep/scenes/room.json", licence, *(f"flockstep.libs/{name}" for name in libraries)):
                archive.writestr(name, "")
        return tmp_path / "made.whl"

    monkeypatch.setattr(wheel, "ROOT", tmp_path)
    assert wheel.check(made("libtbb-12345678.so.12.8", "libembree3.so.3", "libepoxy.so.0")) == "made.whl: 0.0 MB"
    for name in ("libGLX-12345678.so.0.0.0", "libX11.so.6", "libblas.so.3", "liblapack-1.so", "libgfortran.so.5"):
        with refused(SystemExit, "wheel", f"flockstep.libs/{name}"):
            wheel.check(made("libtbb.so.12", name))
