"""The film of a race."""

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

import flockstep
from flockstep.trainings import UNSEEN_SEEDS
from tools import films, race_film
from tools.film import FINER

POLICY = ROOT / "policies" / "race.zip"


@pytest.fixture(scope="module")
def flight():
    return race_film.flown(flockstep.PPO.load(POLICY), UNSEEN_SEEDS.start)


def test_the_film_of_the_page():
    path = ROOT / "docs" / "race.webp"
    assert path.stat().st_size < 1_000_000
    with Image.open(path) as film:
        assert film.size == (800, 450)
        assert film.info["loop"] == 0


def test_the_policy_flies_three_laps(flight):
    gates = flockstep.World.load(race_film.TRACK).gates
    assert flight.success
    assert flight.passed[-1] == 3 * len(gates)
    start = flight.position[0] - gates[0]["center"]  # behind the first gate
    assert 0 < np.linalg.norm(start) < 2
    by_positions = 50 * np.linalg.norm(np.diff(flight.position, axis=0), axis=1)
    assert by_positions.max() == pytest.approx(flight.speed_mps.max(), rel=0.05)
    ends = race_film.lap_ends(flight, len(gates))
    assert len(ends) == 3
    assert [flight.passed[end] for end in ends] == [7, 14, 21]
    assert [flight.passed[end - 1] for end in ends] == [6, 13, 20]
    assert ends[-1] == len(flight.position) - 1


def test_a_flight_that_crashes_is_shown():
    class Falls:
        def predict(self, observation, deterministic):
            return np.float32([[-1, 0, 0, 0]]), None

    flight = race_film.flown(Falls(), UNSEEN_SEEDS.start)
    assert not flight.success
    assert race_film.lap_ends(flight, 7) == []
    scene = race_film.Scene((640, 360))
    last = len(flight.position) - 1
    before, after = (np.asarray(race_film.captioned(scene, flight, step), int) for step in (last - 1, last))
    corners = [picture[:80, :160] for picture in (before, after)]
    alarms = [((corner[..., 0] > 200) & (corner[..., 1] < 150)).any() for corner in corners]
    assert alarms == [False, True]


def test_colours_of_speeds():
    assert race_film.speed_color(0.0) == race_film.speed_color(race_film.SLOW_MPS) == (60, 110, 255)
    assert race_film.speed_color(99.0) == (255, 80, 40)
    assert race_film.speed_color(race_film.SLOW_MPS + (race_film.FAST_MPS - race_film.SLOW_MPS) / 3) == (40, 220, 230)


def test_the_drone_and_the_next_gate_are_where_they_project_to(flight):
    scene = race_film.Scene((640, 360))
    step = 60
    picture = np.asarray(scene.picture(flight, step), int)
    following = (flight.first + int(flight.passed[step])) % len(scene.gates)
    canvas = scene.canvas(following)
    empty = np.asarray(Image.fromarray(canvas.rgb).reduce(FINER), int)
    (x, y, _), (gate_x, gate_y, _) = canvas.project(np.array([flight.position[step], scene.gates[following]["center"]]))
    rows, columns = np.nonzero((picture != empty).any(axis=-1))
    assert np.hypot(columns - x / FINER, rows - y / FINER).min() < 4
    red, green, blue = empty.transpose(2, 0, 1)
    rows, columns = np.nonzero((green > red + 60) & (green > blue + 20))
    assert len(rows) > 50
    assert np.hypot(columns.mean() - gate_x / FINER, rows.mean() - gate_y / FINER) < 8


def test_it_is_written(tmp_path, capsys):
    out = tmp_path / "race.webp"
    films.main(films.Args("race", out=out, width_px=128, film_s=0.2))
    assert "success" in capsys.readouterr().out
    with Image.open(out) as film:
        assert (film.size, film.n_frames) == ((128, 72), 5)
