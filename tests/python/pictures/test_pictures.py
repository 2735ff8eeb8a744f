"""Pictures of docs/: a page shows each, and CONTRIBUTING.md has its command. Paths are plotted in any world."""

import re
from fnmatch import fnmatch
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import ROOT, world_of

from flockstep.pictures.relief import SOLID

DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
SUFFIXES = (".png", ".jpg", ".gif", ".webp", ".svg")
PICTURES = sorted(path for path in IMAGES.rglob("*") if path.suffix in SUFFIXES)
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")


def shown() -> set[Path]:
    """The pictures that the README and the pages of docs/ show."""
    pages = [ROOT / "README.md", *DOCS.rglob("*.md")]
    return {
        (page.parent / target).resolve() for page in pages for target in SHOWN.findall(page.read_text(encoding="utf-8"))
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


pytest.importorskip("stable_baselines3")


def test_a_mesh_and_a_path_that_leaves_it_are_drawn(tmp_path):
    from training.evaluate import Flight
    from training.plot_paths import draw_path, plot_flight

    wall = [[3, -2, 0], [3, 2, 0], [3, 2, 2], [3, -2, 2]]
    floor = [[0, -3, 0], [6, -3, 0], [6, 3, 0], [0, 3, 0]]
    meshes = [{"vertices": corners, "triangles": [[0, 1, 2], [0, 2, 3]]} for corners in (wall, floor)]
    world = world_of(name="wall", meshes=meshes, markers={"goal": [5, 0, 1]})
    trail = np.float32([[1, 0, 1], [1, 2.5, 1], [8, 2.5, 1]])
    flight = Flight("wall", "time", 2, 0.0, 9.5, None, trail)
    figure, axes = plt.subplots()
    for view, corners, dark in (("top", (0, 8, -3, 3), 3), ("side", (0, 8, 0, 2), None)):
        axes.clear()
        draw_path(axes, world, view, flight, ("start",))
        (image,), circles = axes.get_images(), axes.patches
        left, right, bottom, top = image.get_extent()
        assert left < corners[0] < corners[1] < right
        assert bottom < corners[2] < corners[3] < top
        assert right - left == pytest.approx(8 * 1.03)
        assert not circles  # the world has no start
        columns = np.flatnonzero((np.asarray(image.get_array()) == SOLID).all(axis=-1).any(axis=0))
        if dark is not None:  # from above, the cut follows the wall
            np.testing.assert_allclose(left + (columns + 0.5) * (right - left) / 900, dark, atol=0.02)
    draw_path(axes, world, "top", flight, ("goal",))
    assert [circle.center for circle in axes.patches] == [(5, 0)]
    plt.close(figure)
    plot_flight(world, flight, tmp_path / "path.png")
    assert (tmp_path / "path.png").stat().st_size > 1000
