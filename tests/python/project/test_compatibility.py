"""Numbers, supported Pythons and metadata are the same wherever they are written; a wheel names its libraries."""

import hashlib
import importlib.util
import json
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT
from messages import refused

import flockstep
from flockstep import _core

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

HEADERS = ROOT / "engine" / "include" / "flockstep"
#: Hash of the headers that a C++ task includes, for each task format. A release keeps the entry of its format.
TASK_HEADERS = {12: "4e4c2db6b16c341b"}


def text_of(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def project():
    return tomllib.loads(text_of("pyproject.toml"))


def task_headers() -> list[Path]:
    """Return the headers that task.hpp includes, directly or not."""
    found, rest = set(), {"task.hpp"}
    while rest:
        name = rest.pop()
        found.add(name)
        rest |= set(re.findall(r'#include "flockstep/([^"]+)"', (HEADERS / name).read_text(encoding="utf-8"))) - found
    return [HEADERS / name for name in sorted(found)]


def task_format() -> int:
    return int(re.search(r"#define FLOCKSTEP_TASK_FORMAT (\d+)", text_of("engine/include/flockstep/task.hpp"))[1])


def test_the_page_has_the_numbers_of_the_code(room):
    rows = re.findall(r"^\| ([\w+ ]+) \| ([\d.]+) \|", text_of("docs/project/compatibility.md"), re.MULTILINE)
    drone = flockstep.DroneModel.load("x500")
    assert dict(rows) == {
        "package": flockstep.__version__,
        "scene file": str(room.to_dict()["flockstep_scene"]),
        "drone file": str(drone.to_dict()["flockstep_drone"]),
        "recipe": str(json.loads(flockstep.Recipe().to_json())["flockstep_recipe"]),
        "snapshot": str(struct.unpack_from("=QQ", flockstep.Batch([room], 1).snapshot())[1]),
        "protocol of the server": re.search(r"kVersion = (\d+)", text_of("server/src/protocol/frame.hpp"))[1],
        "C++ task": str(task_format()),
    }


def test_the_page_has_the_messages_of_the_code(room):
    page = text_of("docs/project/compatibility.md")
    with pytest.raises(ValueError, match="newer flockstep") as scene:
        flockstep.World.from_dict(room.to_dict() | {"flockstep_scene": 2})
    with pytest.raises(ValueError, match="newer flockstep"):
        flockstep.DroneModel.from_dict({"flockstep_drone": 2, "like": "x500", "wings": 2})
    batch = flockstep.Batch([room], 1)
    blob = bytearray(batch.snapshot())
    struct.pack_into("=Q", blob, 8, 7)
    with refused(ValueError, "snapshot") as snapshot:
        batch.restore(bytes(blob))
    assert str(scene.value).partition(": ")[2] in page
    assert str(snapshot.value) in page


def test_the_task_format_changes_with_the_headers_of_tasks():
    """A library built with other layouts would crash, and the format number is the only thing that refuses it."""
    code = ""
    for header in task_headers():
        without_texts = re.sub(r'"(\\.|[^"\\\n])*"', "", header.read_text(encoding="utf-8"))
        code += re.sub(r"//[^\n]*|\s", "", without_texts)
    found = hashlib.sha256(code.encode()).hexdigest()[:16]
    assert TASK_HEADERS.get(task_format()) == found, (
        "the headers that C++ tasks include have changed. If libraries built before no longer fit (a layout, a virtual "
        "function, the meaning of a value), increase FLOCKSTEP_TASK_FORMAT in task.hpp and its number in "
        f'docs/project/compatibility.md. Then write {task_format()}: "{found}" (or the new number) into TASK_HEADERS'
    )


def test_the_supported_pythons_are_the_same_everywhere(project):
    classifiers = project["project"]["classifiers"]
    stated = [text.rpartition(" :: ")[2] for text in classifiers if re.search(r"Python :: 3\.\d+$", text)]
    tried = re.search(r"^PYTHONS = \((.*)\)$", text_of("packaging/wheel.py"), re.MULTILINE)[1]
    assert re.findall(r"python(3\.\d+)", tried) == stated
    assert project["project"]["requires-python"] == f">={stated[0]}"
    assert f"every Python from {stated[0]} to {stated[-1]}" in text_of("docs/tutorials/install.md")
    settings = project["tool"]["cibuildwheel"]
    ((minors,),) = {tuple(re.findall(r"cp3\{(.*)\}", part["build"])) for part in (settings, settings["linux"])}
    image = re.search(r"for version in ([\d. ]+);", text_of("packaging/Dockerfile"))[1].split()
    assert image == [f"3.{minor}" for minor in minors.split(",")]
    assert stated == image


def test_the_citation_has_the_version_and_licence_of_the_package(project):
    citation = text_of("CITATION.cff")
    assert re.search(r"^version: (.*)$", citation, re.MULTILINE)[1] == flockstep.__version__
    assert re.search(r"^license: (.*)$", citation, re.MULTILINE)[1] == project["project"]["license"]
    assert f"name: {project['project']['authors'][0]['name']}" in citation


def test_the_address_of_the_source_is_written_once(project):
    address = project["project"]["urls"]["Source"]
    assert address.startswith("https://")
    named = [path for path in ("README.md", "CITATION.cff", "SECURITY.md", ".github/workflows/wheels.yml")
             if address in text_of(path)]  # fmt: skip
    assert named == []


# --- libraries in a wheel


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
            for name in (
                "flockstep/scenes/room.json",
                "flockstep/policies/race.zip",
                "flockstep/viewer/page.html",
                licence,
                *(f"flockstep.libs/{name}" for name in libraries),
            ):
                archive.writestr(name, "")
        return tmp_path / "made.whl"

    monkeypatch.setattr(wheel, "ROOT", tmp_path)
    assert wheel.check(made("libtbb-12345678.so.12.8", "libembree3.so.3", "libepoxy.so.0")) == "made.whl: 0.0 MB"
    for name in ("libGLX-12345678.so.0.0.0", "libX11.so.6", "libblas.so.3", "liblapack-1.so", "libgfortran.so.5"):
        with refused(SystemExit, "wheel", f"flockstep.libs/{name}"):
            wheel.check(made("libtbb.so.12", name))
