"""The Python reference: names as users import them.

autoapi reads a copy of the package, in which the stub's fields have the texts of their class's section "Parameters",
and the stub's aliases of array types are written out. Only the public modules get pages; references to a name by the
private module that defines it lead to its public name.
"""

from __future__ import annotations

import ast
import re
import shutil
import textwrap
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon import Config, NumpyDocstring
from sphinx.util.nodes import make_refnode
from stub_copy import copied

ROOT = Path(__file__).resolve().parents[2]
COPY = ROOT / "build" / "docs" / "python" / "flockstep"
#: Classes that calls return but that no public name stands for.
RETURNED = ("Field", "TaskSpec", "Terms")
#: Packages whose types appear in signatures, without a link.
OTHERS = ("collections.", "gymnasium.", "numpy.", "os.", "pathlib.", "ray.", "stable_baselines3.", "torch.", "typing.")
PUBLIC = (
    "flockstep",
    "flockstep.bridges",
    "flockstep.client",
    "flockstep.identification",
    "flockstep.policies",
    "flockstep.rllib",
    "flockstep.rotations",
    "flockstep.sb3",
    "flockstep.scenes",
    "flockstep.testing",
    "flockstep.thesis",
    "flockstep.torch",
)


defined: set[str] = set()  # names of the types in the package's modules


def copy_package(app: Sphinx) -> None:
    """Copy the package for autoapi, in the form that its pages should have."""
    shutil.rmtree(COPY, ignore_errors=True)
    shutil.copytree(ROOT / "envs" / "flockstep", COPY, ignore=shutil.ignore_patterns("__pycache__", "*.so", "*.json"))
    stub = COPY / "_core.pyi"
    stub.write_text(copied(stub.read_text(encoding="utf-8")), encoding="utf-8")
    changes = ast.parse((COPY / "client" / "changes.py").read_text(encoding="utf-8"))
    fields = {node.name: ast.get_docstring(node) or "" for node in changes.body if isinstance(node, ast.ClassDef)}
    for operations in (COPY / "client" / f"{name}.py" for name in ("operations", "drones", "bodies")):
        operations.write_text(in_both_forms(operations.read_text(encoding="utf-8"), fields), encoding="utf-8")
    client = COPY / "client" / "async_client.py"
    text = client.read_text(encoding="utf-8").replace(
        "import AsyncDrone, Operations", "import AsyncDrone, AsyncOperations"
    )
    client.write_text(text.replace("(Operations[AsyncDrone]", "(AsyncOperations[AsyncDrone]"), encoding="utf-8")
    for path in COPY.rglob("*.py*"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
            defined.update(getattr(target, "id", getattr(target, "name", "")) for target in targets)
    for owner, made, after in (
        ("vector_env.py", "env_keywords.py", "Attributes"),
        ("learning/ppo.py", "learning/arguments.py", "Raises"),
    ):
        fields = (COPY / made).read_text(encoding="utf-8").partition("----------\n")[2].partition('\n    """')[0]
        text = (COPY / owner).read_text(encoding="utf-8")
        text = text.replace(f"\n\n    {after}\n", f"\n{fields}\n\n    {after}\n", 1)
        (COPY / owner).write_text(text, encoding="utf-8")  # as its docstring is at run time
    package = COPY / "__init__.py"
    text = package.read_text(encoding="utf-8")
    assignment = "register_task = registration.register_task"
    public = "from flockstep.registration import register_task\nfrom flockstep.trainings.presets import Preset, presets"
    text = text.replace(assignment, public).replace('    "plan",', '    "Preset",\n    "plan",')
    package.write_text(text, encoding="utf-8")


def in_both_forms(text: str, fields: dict[str, str]) -> str:
    """Return the module of operations with a class for each form, as `flockstep.client.forms` makes them.

    ``fields`` has the docstrings of the keywords that stand for ``**fields``.
    """
    for name, about in fields.items():
        listed = textwrap.indent(about.partition("----------\n")[2], " " * 8)
        head, found, rest = text.partition(f"Unpack[{name}]")
        text = head + found + re.sub(r"        \*\*fields\n.*\n", lambda _, to=listed: f"{to}\n", rest, count=1)
    text = re.sub(r"(?<=-> )(?:Call|Subscription)\[(.+)\](?=:\n)", r"\1", text)
    for name in re.findall(r"^class (\w*Operations)\b", text, re.M):
        listed = re.search(rf"^class {name}\b.*?(?=^\S)", text[text.index(f"class {name}") :], re.M | re.S)
        if not listed or "@operation" not in listed[0]:
            continue
        plain = listed[0].replace("    @operation\n", "").replace("_Drone", "Drone")
        streams = re.compile(r"    @stream\n((?:.*\n)*?.*-> )(.+)(?=:\n)")
        awaiting = re.sub(r"@operation\n    def", "async def", listed[0]).replace("_Drone", "AsyncDrone")
        both = streams.sub(r"\1Stream[\2]", plain)
        awaiting = re.sub(r"(?<=[(, ])(Body|Sensor)(?=Operations\b)", r"Async\1", awaiting)
        both += streams.sub(r"\1AsyncStream[\2]", awaiting).replace(f"class {name}", f"class Async{name}")
        text = text.replace(listed[0], both)
    text = text.replace("import BlockingBodies", "import AsyncBodyOperations, BlockingBodies")
    text = text.replace("import Drone, SensorOperations", "import AsyncSensorOperations, Drone, SensorOperations")
    text = text.replace("class AsyncDrone(DroneOperations", "class AsyncDrone(AsyncDroneOperations")
    return text


def is_skipped(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: list[str]) -> bool | None:
    """Return whether something has no place in the reference."""
    if what in ("module", "package"):
        return name not in (*PUBLIC, "flockstep._core")
    own, _, short = name.rpartition(".")
    if own == "flockstep._core":
        return short not in RETURNED
    return short.startswith("_") or (skip and not name.startswith("flockstep.testing.CHECKS"))


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> nodes.Element | None:
    """Find what a name by its private module, or without its class, refers to.

    A name that several classes have, such as that of an argument, stays plain text. One that nothing has is an error.
    """
    if node.get("refdomain") != "py":
        return None
    objects = env.get_domain("py").objects
    target = node["reftarget"]
    short = re.sub(r"^flockstep\.(?:[a-z_0-9]+\.)*", "", target)
    found = [f"{module}.{short}" for module in PUBLIC if f"{module}.{short}" in objects]
    if not found:
        found = [name for name in objects if name.endswith(f".{short}")]
        if len(found) > 1:
            return content
    if not found:
        is_type = node["reftype"] == "class" and (short in defined or target.startswith(OTHERS))
        return nodes.Text(target.rpartition(".")[2]) if is_type else None
    entry = objects[found[0]]
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, content, found[0])


def read_sections(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Turn the sections of a docstring, such as "Parameters", into fields."""
    text = re.sub(r"\|(\w+)\|", r"\\|\1\\|", "\n".join(lines))  # the length of a list, which is no substitution
    lines[:] = text.split("\n")
    if what not in ("attribute", "data", "property"):  # which Napoleon takes for "type: description"
        config = Config(napoleon_use_param=False, napoleon_use_rtype=False)
        config.napoleon_custom_sections = ["Infos", ("Attributes", "params_style")]
        lines[:] = NumpyDocstring(lines, config, app, what, name).lines()


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension with Sphinx."""
    app.connect("builder-inited", copy_package, priority=100)
    app.connect("autoapi-skip-member", is_skipped)
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", read_sections)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
