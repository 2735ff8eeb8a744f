"""The film of a flight through a playground."""

import numpy as np
import pytest
from conftest import ROOT
from messages import refused
from PIL import Image

import flockstep
from tools import films, flight_film
from tools.film import FINER
from training.evaluate import MAX_STEPS, fly, greedy
from training.tasks import load_policy

POLICY = ROOT / "policies" / "lidar.zip"


@pytest.fixture(scope="module")
def world():
    return flockstep.World.playground(films.FILMS["flight"].seed, pillars=flight_film.PILLARS)


@pytest.fixture(scope="module")
def flight(world):
    (one,) = fly(greedy(load_policy(POLICY)), [world], MAX_STEPS)
    return one


@pytest.fixture(scope="module")
def content(world, flight):
    return flight_film.shown(world, flight.trail.astype(float))


def test_the_film_of_the_readme():
    path = ROOT / "docs" / "flight.webp"
    assert path.stat().st_size < 1_000_000
    with Image.open(path) as film:
        assert film.size == (800, 450)
        assert 8 <= film.n_frames / flight_film.FPS <= 12
        assert film.info["loop"] == 0


def test_it_is_written(tmp_path, capsys):
    out = tmp_path / "flight.webp"
    films.main(films.Args("flight", out=out, width_px=128, film_s=0.2))
    assert "success" in capsys.readouterr().out
    with Image.open(out) as film:
        assert (film.size, film.n_frames) == ((128, 72), 4)
        durations = []
        for index in range(film.n_frames):
            film.seek(index)
            film.load()
            durations.append(film.info["duration"])
    assert durations == [67, 67, 67, 1500]


def test_the_flight_succeeds_and_the_film_stays_close_to_it(world, flight, content):
    assert flight.outcome == "success"
    gaps = np.linalg.norm(content.position[:, None] - flight.trail[None], axis=2)
    assert gaps.min(axis=1).max() < 0.2
    assert gaps.min(axis=0).max() < 0.2
    assert content.smoothed_m < 0.2
    assert (np.diff(content.reached) >= 0).all()
    assert content.reached[[0, -2, -1]].tolist() == [0, len(world.waypoints), len(world.waypoints) + 1]


def test_beams_are_those_of_a_scan_at_the_pose(world, content):
    index = len(content.position) // 2
    origin, ends, hit = content.beams[index]
    assert len(ends) == 35
    np.testing.assert_allclose(origin, content.position[index], atol=1e-5)
    away = np.linalg.norm(ends - origin, axis=1)
    t_hit = world.raycast(np.tile(origin, (35, 1)), ends - origin, 3.0)["t_hit"]
    np.testing.assert_array_equal(hit, np.isfinite(t_hit))
    np.testing.assert_allclose(away, np.where(hit, t_hit, 3.0), atol=1e-3)
    assert 0 < hit.sum() < 35


def test_a_path_that_is_not_free_is_refused(world):
    pillar = np.array(next(p for p in world.primitives if p["kind"] == "cylinder")["center"])
    trail = pillar + np.linspace([-2, 0, 0], [2, 0, 0], 41)
    with refused(RuntimeError, "trail"):
        flight_film.shown(world, trail)


def test_the_drone_is_where_it_projects_to(world, content):
    scene = flight_film.Scene(world, content.position, (400, 225))
    index = 60
    picture = np.asarray(scene.picture(content, index), int)
    moved = np.asarray(scene.picture(content, 0), int)
    rgb = np.zeros((225 * FINER, 400 * FINER, 3), np.uint8)
    canvas = flight_film.DepthCanvas(
        rgb, np.zeros(rgb.shape[:2], np.float32), scene.camera, scene.viewer, scene.turn, flight_film.LIGHT
    )
    x, y, _ = canvas.project(content.position[[index]])[0] / FINER
    red, green, blue = picture.transpose(2, 0, 1)
    front = (red > 180) & (red > green + 60) & (green > blue + 30) & (picture != moved).any(axis=-1)
    rows, columns = np.nonzero(front)
    near = np.hypot(columns - x, rows - y) < 25
    assert near.sum() > 40  # the rotors in front
    assert columns[near].mean() > x + 2  # it faces +x, which is to the right
