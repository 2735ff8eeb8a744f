"""help(), inspect and completion: the stub's documentation is available at run time."""

import ast
import importlib
import inspect
import pydoc
import re
from pathlib import Path

import pytest
from conftest import ROOT
from messages import refused

import flockstep
from flockstep import _core, keywords

STUB = Path(flockstep.__file__).parents[0] / "_core.pyi"
if not STUB.exists():  # an editable install reads the checkout
    STUB = ROOT / "envs" / "flockstep" / "_core.pyi"
TREE = ast.parse(STUB.read_text(encoding="utf-8"))


def members():
    """Path and object of every public name of the module and of its classes."""
    for name, item in vars(_core).items():
        if name.startswith("_"):
            continue
        yield name, item
        if isinstance(item, type):
            for member in vars(item):
                if not member.startswith("_"):
                    yield f"{name}.{member}", inspect.getattr_static(item, member)


MEMBERS = {path: item for path, item in members() if not isinstance(item, str)}


def stubbed():
    """(path, function) of every function and method in the stub."""
    for node in TREE.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, node
        for member in node.body if isinstance(node, ast.ClassDef) else []:
            decorated = isinstance(member, ast.FunctionDef) and any(
                ast.unparse(decorator) != "staticmethod" for decorator in member.decorator_list
            )
            public = isinstance(member, ast.FunctionDef) and (
                not member.name.startswith("_") or member.name == "__init__"
            )
            if public and not decorated:
                yield f"{node.name}.{member.name}", member


FUNCTIONS = dict(stubbed())


def found(path):
    item = _core
    for name in path.split("."):
        item = getattr(item, name)
    return item


def test_there_is_something_to_look_at():
    assert len(MEMBERS) > 180
    assert len(FUNCTIONS) > 50


def test_everything_has_a_docstring():
    wrong = [path for path, item in MEMBERS.items() if not item.__doc__ or "pybind11" in item.__doc__]
    assert not wrong


def test_signatures_and_docstrings_are_those_of_the_stub():
    wrong = []
    for path, function in FUNCTIONS.items():
        arguments = function.args
        for argument in [*arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg]:
            if argument is not None:
                argument.annotation = None
        expected = f"({ast.unparse(arguments)})".replace("...", "Ellipsis")
        text = inspect.getdoc(found(path))
        is_same = path.endswith("__init__") or text == ast.get_docstring(function)
        if str(inspect.signature(found(path))) != expected or not is_same:
            wrong.append(path)
    assert not wrong


def test_help_shows_what_a_newcomer_looks_for():
    text = pydoc.plain(pydoc.render_doc(flockstep.LidarConfig))
    assert "max_range_m=3.0" in text
    assert "Beyond it is a miss: inf in metres" in text
    assert flockstep.LidarConfig.max_range_m.__doc__.endswith("Values: > 0 m. Default: 3.0.")
    assert str(inspect.signature(flockstep.ClockConfig)).startswith("(*, policy_hz=")


CONFIGURATIONS = [item for item in vars(_core).values() if hasattr(item, "_fields")]


def test_fields_say_what_they_mean_and_their_defaults():
    described = [(config, field) for config in CONFIGURATIONS for field in config._fields]
    names = [(config, name) for config in CONFIGURATIONS for name in config.__match_args__]
    assert [(config, field["name"]) for config, field in described] == names
    for config, field in described:
        text = " ".join(getattr(config, field["name"]).__doc__.split())
        assert field["about"].endswith("."), field
        assert text.startswith(field["about"]), field
        assert text.endswith(f"Default: {field['shown']}."), field
        default = getattr(config(), field["name"])
        if hasattr(default, "_fields"):
            assert field["shown"] == f"{type(default).__name__}()"
        elif isinstance(default, (int, str)):
            assert field["shown"] == repr(default)
        assert f"\n{field['name']}\n    " in inspect.getdoc(config)


def runs(text):
    """Return the runs of nine words of a text."""
    words = re.findall(r"\w+", text.lower())
    return {*zip(*(words[i:] for i in range(9)), strict=False)}


def test_docstrings_say_nothing_that_headers_say(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "bindings")
    documents = importlib.import_module("documents")
    said = set()
    for header in ROOT.glob("*/include/flockstep/**/*.hpp"):
        if header.parent.name == "tasks":  # words of tasks are texts of the program, which marks do not name
            continue
        text = header.read_text(encoding="utf-8")
        said |= runs(" ".join(re.findall(r"//+ ?(.*)", text)))
        said |= runs(" ".join(re.findall(r'"((?:\\.|[^"\\])*)"', re.sub(r'"\s*"', "", text))))
    text = (ROOT / "bindings" / "core.pyi").read_text(encoding="utf-8")
    assert sorted(runs(text) & said) == []  # docstrings name such a comment: see bindings/documents.py
    assert len(runs(documents.with_comments(text)) & said) > 100
    for mark in ("{planning.hpp: Each place had}", "{planning.hpp: drone}"):  # in no comment, in several
        with pytest.raises(ValueError, match=r"expected one comment of planning\.hpp"):
            documents.with_comments(mark)


def test_stub_and_documents_are_made_from_the_lists_of_the_engine(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "bindings")
    stubs = importlib.import_module("stubs")
    assert len(stubs.DOCUMENTS) > 10
    assert STUB.read_text(encoding="utf-8") == stubs.stub_text()  # which the build writes
    for made in (stubs.TEMPLATE, *stubs.MADE, *stubs.DOCUMENTS):
        assert made.read_text(encoding="utf-8") == stubs.renewed(made), f"{made.name}: run bindings/stubs.py"
    # Each configuration has its table, except for those that configs.md leaves to `help` and other pages.
    pages = [stubs.ROOT / "docs" / "reference" / name for name in ("configs.md", "drone-files.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    sensors = "PoseSensor Imu Barometer Magnetometer GpsReceiver OpticalFlow"
    others = {f"{name}Config" for name in f"Network Rollout Update Server Gradient {sensors}".split()}
    others |= {
        "NavigationReward",
        "GateDetector",
        "ColorRange",
        "Variation",
        "RangeErrors",
        "DepthErrors",
        "ColorErrors",
        "EventPixels",
    }
    others |= {config.__name__ for config in _core.engine_tasks.values()}
    named = {config.__name__ for config in CONFIGURATIONS} - others
    for name in [*sorted(named), "Airframe", "BatchConfig"]:
        assert f"<!-- fields of {name} -->\n| field |" in text, name


def test_public_python_has_docstrings():
    for name in set(flockstep.__all__) - {"rllib"}:  # Ray needs a separate environment
        item = getattr(flockstep, name)
        if isinstance(item, str):
            continue
        assert item.__doc__, name
        for member, value in vars(item).items() if isinstance(item, type) else []:
            if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                assert value.__doc__ or inspect.getdoc(getattr(item, member)), f"{name}.{member}"


def test_the_env_shows_every_keyword():
    """In its signature and its text: its own, the fields of its recipe, and the kept fields of configurations."""
    named = inspect.signature(flockstep.DroneVectorEnv).parameters
    text = inspect.getdoc(flockstep.DroneVectorEnv).split("\nAttributes\n")[0]
    assert keywords.FLAT | set(_core.batch_keywords) <= set(named)
    for name in set(named) - keywords.FLAT | {"autoreset_mode"}:
        assert f"\n{name}\n    " in text, name
    for name in keywords.FLAT - {"autoreset_mode"}:
        assert f"``{name}``" in text, name
    tasks = {name: config() for config in _core.engine_tasks.values() for name in config.__match_args__}
    for name in keywords.FLAT | set(_core.batch_keywords):  # the env does accept each of them
        with pytest.raises((TypeError, ValueError), match=name) as caught:
            flockstep.DroneVectorEnv(task=tasks.get(name), **{name: object()})
        assert "unexpected keyword" not in str(caught.value)


def test_a_new_field_goes_by_its_configuration():
    """The kept list is that of the first release; the fields of a configuration that it lacks are no keywords."""
    known = {name for config in CONFIGURATIONS for name in config.__match_args__}
    assert known >= keywords.FLAT, "a name that no configuration has"
    assert len(keywords.FLAT) <= 84
    with refused(TypeError, "position_noise_std_m", "pose_sensor", "flockstep.PoseSensorConfig"):
        flockstep.DroneVectorEnv(position_noise_std_m=1.0)


@pytest.mark.parametrize("kind", [flockstep.DroneVectorEnv, flockstep.DroneEnv])
def test_the_env_documents_every_public_member(kind):
    env = kind(render_mode="rgb_array")
    attributes = inspect.getdoc(kind).split("\nAttributes\n")[1].split("\n\n")[0]
    heads = {name for line in attributes.splitlines() if not line.startswith(" ") for name in line.split(", ")}
    for name in dir(env):
        if name.startswith("_"):
            continue
        item = inspect.getattr_static(kind, name, None)
        documented = (callable(item) or isinstance(item, (property, classmethod))) and inspect.getdoc(
            getattr(kind, name)
        )
        assert documented or name in heads, name
