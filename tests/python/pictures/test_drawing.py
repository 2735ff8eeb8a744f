"""The additions of `Task.draw` to pictures, and the markers in them."""

import sys

import numpy as np
import pytest
from conftest import begun
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep.pictures.drawing import COLORS, Drawing
from flockstep.pictures.stage import Stage
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.top_view import TopView

INK = (250, 10, 200)  # nothing else has this colour
LENGTH = 0.93  # of the default drone, m


class Drawn(Still):
    camera = flockstep.CameraConfig(width_px=16, height_px=12)
    places = ((4.5, 6.5, 2.2), (5.5, 6.2, 2.2))

    def reset(self, batch, mask):
        batch.set_pose(np.tile(np.float32([2, 6, 2]), (batch.num_drones, 1)), None, mask)

    def draw(self, batch, env, drawing):
        drawing.points(self.places[env], INK, size=8)


def frames(world, task, view, num_envs=1, **keywords):
    envs = begun(num_envs, worlds=world, task=task, render_mode="rgb_array", render_view=view, **keywords)
    return envs.render()


def inked(image):
    """(row, column), each (K,), of the pixels in the ink's colour."""
    return np.nonzero((image == INK).all(axis=-1))


def test_a_point_is_where_it_projects_to_behind_the_drone(room):
    """Compare with the stage's own pose and the pinhole formula."""
    images = frames(room, Drawn, "third_person", 2)
    canvas, _ = Stage(room, LENGTH, (640, 480)).set(np.array([2.0, 6, 2]), np.array([1.0, 0, 0, 0]))
    for image, place in zip(images, Drawn.places, strict=True):
        rows, columns = inked(image)
        ((x, y, _),) = canvas.project(np.array([place]))
        assert len(rows) >= 49  # 8 by 8 pixels, whose borders may be mixed
        assert columns.mean() + 0.5 == pytest.approx(x, abs=0.8)
        assert rows.mean() + 0.5 == pytest.approx(y, abs=0.8)


def test_a_point_is_where_it_projects_to_from_a_fixed_place(room):
    """From (2, 1, 2) towards +y over 75 degrees: half the width is 320 pixels, or tan(37.5 degrees) at 1 m."""
    images = frames(room, Drawn, ((2, 1, 2), (2, 5, 2)), 2)
    focal = 320 / np.tan(np.radians(37.5))
    for image, (x, y, z) in zip(images, Drawn.places, strict=True):
        rows, columns = inked(image)
        assert columns.mean() + 0.5 == pytest.approx(320 + focal * (x - 2) / (y - 1), abs=0.8)
        assert rows.mean() + 0.5 == pytest.approx(240 - focal * (z - 2) / (y - 1), abs=0.8)


def test_a_point_is_where_it_is_from_above(room):
    images = frames(room, Drawn, "top", 2)
    for image, (x, y, _) in zip(images, Drawn.places, strict=True):
        rows, columns = inked(image)
        assert len(rows) == 64
        assert columns.mean() == pytest.approx(127.5 + (x - 4) * 256 * 0.96 / 8, abs=1)
        assert rows.mean() == pytest.approx(127.5 - (y - 4) * 256 * 0.96 / 8, abs=1)


def test_every_view_but_the_drones_own_camera_calls_it(room):
    for view in ("top", "third_person", "fleet", ((1, 1, 2), (5, 6.4, 2))):
        assert len(inked(frames(room, Drawn(), view)[0])[0]) >= 49, view
    assert not len(inked(frames(room, Drawn(), "camera")[0])[0])


def test_what_is_nearer_hides_it(room):
    """The pillar at (4, 4.5) stands between a fixed place and a sphere; a line ends at the surface of the pillar."""

    class Hidden(Drawn):
        markers = ()
        camera = None

        def draw(self, batch, env, drawing):
            drawing.spheres([[4, 6.5, 2]], 0.15, INK)
            drawing.lines([[4, 6.5, 1.5]], [[2, 6.5, 1.5]], INK, width=2)
            drawing.points([6.5, 6.5, 2], INK)

    (image,) = frames(room, Hidden, ((4, 1, 2), (4, 5, 2)))
    focal = 320 / np.tan(np.radians(37.5))
    half_pillar = focal * 0.25 / np.sqrt(3.5**2 - 0.25**2)  # from the tangents through the place
    rows, columns = inked(image)
    assert not ((columns > 320 - half_pillar + 1) & (columns < 320 + half_pillar - 1)).any()
    line = columns[rows > 260]
    assert line.min() + 0.5 == pytest.approx(320 - focal * 2 / 5.5, abs=2)
    assert line.max() + 0.5 == pytest.approx(320 - half_pillar, abs=2)


def test_lines_and_spheres_from_above(room):
    class Lines(Drawn):
        def draw(self, batch, env, drawing):
            drawing.lines([1, 2, 3], [[1, 7, 3], [3, 2, 0]], INK, width=1)
            drawing.spheres([6, 6.5, 1], 0.8, INK)

    (image,) = frames(room, Lines, "top", render_size=(480, 480))
    px_per_m = 480 * 0.96 / 8
    rows, columns = inked(image)
    x, y = (columns - 239.5) / px_per_m + 4, 4 - (rows - 239.5) / px_per_m
    disc = np.hypot(x - 6, y - 6.5) < 0.85
    assert disc.sum() == pytest.approx(np.pi * (0.8 * px_per_m) ** 2, rel=0.03)
    upright, level = np.abs(x - 1) < 0.51 / px_per_m, np.abs(y - 2) < 0.51 / px_per_m
    assert (disc | upright | level).all()
    assert (upright & (y > 1.99)).sum() == pytest.approx(5 * px_per_m, abs=2)
    assert (level & (x > 0.99)).sum() == pytest.approx(2 * px_per_m, abs=2)


PLACE = ((2, 1, 2), (2, 5, 2))  # level, towards +y, with +x to the right
VIEWS = pytest.mark.parametrize("view", ["top", "third_person", PLACE], ids=["top", "third_person", "place"])


def drawn_by(call, world, view, **keywords):
    """The picture of a task that draws with this call, without beams and markers."""
    task = type("Called", (Drawn,), {"markers": (), "draw": lambda self, batch, env, drawing: call(drawing)})
    return frames(world, task, view, **keywords)[0].astype(int)


def nothing(drawing):
    pass


def test_a_cell_is_where_it_projects_to_from_a_fixed_place(room):
    """Compute the point of the floor at each pixel; the floor shines through the cell."""
    before = drawn_by(nothing, room, PLACE)
    after = drawn_by(lambda d: d.cells([2, 4.5, 0], 2, INK), room, PLACE)
    focal = 320 / np.tan(np.radians(37.5))
    column, row = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    ahead = 2 * focal / np.maximum(row - 240, 1e-3)
    outside = np.maximum(np.abs((column - 320) / focal * ahead), np.abs(1 + ahead - 4.5)) - 1
    border = ahead**2 / focal  # m: two pixels of floor
    assert (outside < -border).sum() > 5000
    blended = before + 0.6 * (np.array(INK) - before)
    assert np.abs(after - blended)[outside < -border].max() <= 1.5
    np.testing.assert_array_equal(after[outside > border], before[outside > border])


def test_what_is_nearer_hides_a_cell(room):
    """The pillar at (4, 4.5) from (4, 1); cells in front of it are visible."""
    view = ((4, 1, 2), (4, 5, 2))
    calls = (nothing, lambda d: d.cells([4, 7, 0], 2, INK), lambda d: d.cells([4, 3.4, 1], 1, INK))
    before, behind, ahead = (drawn_by(call, room, view) for call in calls)
    half_pillar = 320 / np.tan(np.radians(37.5)) * 0.25 / np.sqrt(3.5**2 - 0.25**2)
    pillar = np.s_[:, int(320 - half_pillar) + 2 : int(320 + half_pillar) - 2]
    np.testing.assert_array_equal(behind[pillar], before[pillar])
    assert (behind != before).any(axis=2).sum() > 1000
    assert (ahead != before).any(axis=2)[pillar].sum() > 1000


def test_a_cell_is_where_it_is_from_above_and_below_all_else(room):
    def cell_and_point(drawing):
        drawing.points([3, 5, 0], "red")
        drawing.cells([3, 5, 0], 4, INK)
        drawing.points([2, 5, 0], "red")

    before, after = (drawn_by(call, room, "top", render_size=(500, 500)) for call in (nothing, cell_and_point))
    px_per_m = 500 * 0.96 / 8
    column, row = np.meshgrid(np.arange(500), np.arange(500))
    x, y = (column - 249.5) / px_per_m + 4, 4 - (row - 249.5) / px_per_m
    points = (after == COLORS["red"]).all(axis=2)
    assert points.sum() == 2 * 36
    inside = (np.maximum(np.abs(x - 3), np.abs(y - 5)) < 2) & ~points
    floor = (before == (252, 252, 250)).all(axis=2)  # without the pillar at (4, 4.5) and the drone at (2, 6)
    assert (inside & ~floor).sum() > 500
    np.testing.assert_array_equal(
        after[inside & floor][0], np.rint(0.4 * np.array([252, 252, 250]) + 0.6 * np.array(INK))
    )
    assert np.unique(after[inside & floor], axis=0).shape == (1, 3)
    same = ~(inside & floor | points)
    np.testing.assert_array_equal(after[same], before[same])


def test_beams_shine_over_cells(room):
    """Beams are glass of opacity 0.6, so every pixel of a cell moves towards their colour by that fraction."""
    bare = type("Bare", (Drawn,), {"markers": (), "draw": lambda self, batch, env, drawing: None})
    cell = type("Cell", (bare,), {"draw": lambda self, batch, env, drawing: drawing.cells([4, 4, 0], 8, INK)})
    scanned = type("Scanned", (cell,), {"lidar": flockstep.LidarConfig(beams=35, max_range_m=2)})
    before, after, lit = (frames(room, task, "third_person")[0].astype(float) for task in (bare, cell, scanned))
    full = np.array([250, 130, 70]) - after
    share = ((lit - after) * full).sum(axis=2) / (full**2).sum(axis=2)
    assert (share > 0.5)[(after != before).any(axis=2)].sum() > 20


@VIEWS
def test_cells_that_meet_leave_no_seam_and_the_last_wins(room, view):
    grid = np.stack(np.meshgrid(np.arange(0.1, 7.9, 0.2), np.arange(0.1, 7.9, 0.2), [0]), axis=-1).reshape(-1, 3)
    one = drawn_by(lambda d: d.cells([3.9, 3.9, 0], 7.8, INK), room, view)
    many = drawn_by(lambda d: d.cells(grid, 0.2, INK), room, view)
    over = drawn_by(lambda d: d.cells([[4, 4, 0], [3.9, 3.9, 0]], 7.8, [(0, 255, 0), INK]), room, view)
    assert (one != drawn_by(nothing, room, view)).any(axis=2).mean() > 0.1
    np.testing.assert_array_equal(one, many)
    green = (one != over).any(axis=2)
    assert (over[green][:, 1] > one[green][:, 1]).all()  # the remainder of the first below the last
    assert 0 < green.mean() < 0.1


@VIEWS
def test_a_text_has_its_middle_on_its_place_and_grows_with_the_picture(room, view):
    place = [3.0, 6.3, 2.2]
    sizes = []
    for scale in (1, 2):
        size = {"render_size": (640 * scale, 480 * scale)}
        mark = drawn_by(lambda d: d.points(place, INK, size=4), room, view, **size)
        both = drawn_by(lambda d: d.text(place, "HOH", (0, 0, 0), size=30), room, view, **size)
        changed = (both != drawn_by(nothing, room, view, **size)).any(axis=2)
        rows, columns = np.nonzero(changed)
        middle = [edge.mean() for edge in inked(mark)]
        assert (rows.min() + rows.max()) / 2 == pytest.approx(middle[0], abs=scale + 1)
        assert (columns.min() + columns.max()) / 2 == pytest.approx(middle[1], abs=scale + 1)
        sizes.append((np.ptp(rows) + 1, np.ptp(columns) + 1))
        inside = both[changed]
        assert (inside == 0).all(axis=1).any(), "letters"
        assert (inside == 255).all(axis=1).any(), "and their edge"
    np.testing.assert_allclose(sizes[1], 2 * np.array(sizes[0]), rtol=0.08)
    assert 20 < sizes[0][0] < 38


def test_a_text_without_pillow_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with refused(ModuleNotFoundError, "Drawing.text", "pip install pillow"):
        Drawing(Sheet(), 1).text([0, 0, 0], "not written before")


@VIEWS
def test_what_is_beyond_the_picture_or_nowhere_is_left_out(room, view):
    def far(drawing):
        drawing.cells(np.zeros((0, 3)), 1)
        drawing.cells([[1e6, 0, 0], [-1e300, 1e300, 0]], 1, INK)
        drawing.text([1e6, 0, 2], "far")

    np.testing.assert_array_equal(drawn_by(far, room, view), drawn_by(nothing, room, view))


def test_what_is_nearer_hides_a_text_and_a_text_what_is_farther(room):
    """The pillar at (4, 4.5) from (4, 1): the text behind it is wider than the pillar."""
    view = ((4, 1, 2), (4, 5, 2))
    before, after = (drawn_by(call, room, view) for call in (nothing, lambda d: d.text([4, 6, 2], "O" * 20)))
    changed = (before != after).any(axis=2).any(axis=0)
    half_pillar = 320 / np.tan(np.radians(37.5)) * 0.25 / np.sqrt(3.5**2 - 0.25**2)
    assert not changed[int(320 - half_pillar) + 2 : int(320 + half_pillar) - 2].any()
    assert changed[: int(320 - half_pillar)].sum() > 50
    assert changed[int(320 + half_pillar) :].sum() > 50

    def text(drawing):
        drawing.text([4, 3, 2], "HHH", (0, 0, 0), size=60)

    def point(drawing):
        drawing.points([4, 4, 2], "red", size=40)

    alone, covered, bare = (
        drawn_by(call, room, view) for call in (text, lambda d: [text(d), point(d)], lambda d: point(d))
    )
    letters = (alone == 0).all(axis=2)
    assert (letters & (bare == COLORS["red"]).all(axis=2)).sum() > 50
    assert (covered[letters] == 0).all()
    assert (covered != alone).any()
    behind = drawn_by(lambda d: d.text([4, 0.5, 2], "behind the viewer"), room, view)
    np.testing.assert_array_equal(behind, before)


class Sheet:
    """A canvas that records all calls."""

    def __init__(self):
        self.drawn = []

    def dots(self, points, color, *, size_px):
        self.drawn.append((points.tolist(), color, size_px))

    def lines(self, starts, ends, color, *, width_px):
        self.drawn.append((starts.tolist(), ends.tolist(), color, width_px))

    def sphere(self, center, radius_m, color):
        self.drawn.append((center.tolist(), radius_m, color))

    def cells(self, centers, size_m, colors):
        self.drawn.append((centers.tolist(), size_m, colors.tolist()))

    def stamp(self, place, picture):
        self.drawn.append((place.tolist(), picture.shape))


def test_colours_sizes_and_places_that_are_not_finite():
    sheet = Sheet()
    drawing = Drawing(sheet, 3)
    drawing.points(np.float32([[1, 2, 3], [np.inf, 0, 0]]), "red", size=2)
    drawing.lines([0, 0, 0], [[1, 1, 1], [np.nan, 1, 1], [2, 2, 2]], np.array([1, 2, 3]), width=0.1)
    drawing.spheres([[0, 0, 1], [0, 0, -np.inf]], 2, (4, 5, 6))
    assert sheet.drawn == [
        ([[1, 2, 3]], COLORS["red"], 6),
        ([[0, 0, 0], [0, 0, 0]], [[1, 1, 1], [2, 2, 2]], (1, 2, 3), 1),
        ([0, 0, 1], 2, (4, 5, 6)),
    ]
    drawing.points(np.zeros((0, 3)))
    assert len(sheet.drawn) == 4
    sheet.drawn.clear()
    drawing.cells([[1, 2, 0], [np.nan, 0, 0], [3, 4, 0]], 0.5, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    drawing.cells([1, 2, 0], 2, "red")
    drawing.text([np.inf, 0, 0], "nowhere")
    drawing.text([0, 0, 0], " ")
    assert sheet.drawn == [
        ([[1, 2, 0], [3, 4, 0]], 0.5, [[1, 2, 3], [7, 8, 9]]),
        ([[1, 2, 0]], 2, [list(COLORS["red"])]),
    ]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda d: d.points([1, 2]), ["positions", (2,)]),
        (lambda d: d.points([1, 2, 3], "pink"), ["color", "pink"]),
        (lambda d: d.points([1, 2, 3], (0.5, 0, 0)), ["color", "three integers"]),
        (lambda d: d.points([1, 2, 3], (0, 0, 256)), ["color", "three integers"]),
        (lambda d: d.points([1, 2, 3], size=0), ["size", 0]),
        (lambda d: d.lines(np.zeros((2, 3)), np.zeros((3, 3))), ["ends", 2]),
        (lambda d: d.lines([0, 0, 0], [1, 1, 1], width="wide"), ["width", "wide"]),
        (lambda d: d.spheres([0, 0, 0], -1), ["radius_m", -1]),
        (lambda d: d.cells([0, 0], 1), ["centers", (2,)]),
        (lambda d: d.cells([0, 0, 0], np.inf), ["size_m", np.inf]),
        (lambda d: d.cells(np.zeros((2, 3)), 1, [[0, 0, 0]]), ["color", "three integers"]),
        (lambda d: d.cells(np.zeros((1, 3)), 1, [[0, 0, 256]]), ["color", "three integers"]),
        (lambda d: d.text(np.zeros((2, 3)), "two"), ["position", (2, 3)]),
        (lambda d: d.text([0, 0, 0], "x", size=0), ["size", 0]),
        (lambda d: d.text([0, 0, 0], 3), ["string", 3]),
    ],
)
def test_mistakes_are_reported_before_anything_is_drawn(call, said):
    sheet = Sheet()
    with refused((ValueError, TypeError), *said):
        call(Drawing(sheet, 1))
    assert not sheet.drawn


def marker_colors(world, task, view):
    """The world's markers with visible pixels: red, yellow and green ones, colours that a hull does not have."""
    drone = flockstep.DroneModel(flockstep.DroneModel().hull)
    r, g, b = frames(world, task, view, drone=drone)[0].astype(int).transpose(2, 0, 1)
    masks = {
        "start": (r > 1.8 * g) & (r > 1.8 * b) & (r > 80),
        "waypoints": (r > 1.8 * b) & (g > 1.5 * b) & (r > 90),
        "goal": (g > 1.4 * r) & (g > 1.4 * b) & (g > 50),
    }
    return [name for name, mask in masks.items() if mask.sum() > 15]


@pytest.mark.parametrize("view", ["top", ((4, 0.3, 3), (4, 4, 2))])
def test_markers_a_task_does_not_use_are_not_drawn(room, view):
    for used in (("start", "waypoints", "goal"), ("goal",), ["start"], ()):

        class Some(Drawn):
            markers = used
            lidar = None

            def draw(self, batch, env, drawing):
                pass

        assert marker_colors(room, Some, view) == list(used)


def test_a_drones_own_camera_sees_the_markers_all_the_same(room):
    class Bare(Drawn):
        markers = ()
        camera = flockstep.CameraConfig(width_px=64, height_px=48)

    (image,) = frames(room, Bare, "camera")
    expected = flockstep.render(room, (2, 6, 2), camera=Bare.camera)["rgb"]
    np.testing.assert_array_equal(image, expected)
    assert (expected[..., 1] > 1.4 * expected[..., 0].astype(int)).any()  # the goal is in view


def test_drawing_is_for_one_env_at_a_time_and_changes_nothing(room):
    envs = begun(2, worlds=room, task=Drawn(), render_mode="rgb_array", render_view="top")
    before = envs.snapshot()
    first = envs.render()
    assert envs.snapshot() == before
    np.testing.assert_array_equal(first, envs.render())
    batch = flockstep.Batch([room], 1)
    batch.remove([0])
    for view in (TopView(batch, overlay=Drawn()), ThirdPersonView(batch, overlay=Drawn())):
        assert not len(inked(view.frame(0))[0])
