"""The films and pictures of the documents: what they show is where it is drawn, and each is written."""

from dataclasses import replace

import imageio.v3 as imageio
import numpy as np
import pytest
from conftest import ROOT, begun
from messages import refused
from PIL import Image

import flockstep
from flockstep.pictures import third_person_view
from flockstep.pictures.lines import beams_of
from flockstep.relight import DARK_LIGHT
from flockstep.rotations import rotate
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS, judge
from tools import catch_film, films, flight_film, race_film, stills, track_film
from tools.film import ALARM, FINER, flown
from tools.slice_picture import LIDAR, PLACE, Slice, draw
from training.evaluate import MAX_STEPS, fly, greedy
from training.forest_flight import ForestFlight
from training.rotor_navigation import RotorNavigation

FOREST = flockstep.World.forest(0, trees=20, size_m=(30, 20))
PLAYGROUND = flockstep.World.load("playground/train-1")


@pytest.mark.parametrize(
    ("name", "task", "kind", "world"),
    [("forest", ForestFlight, "forest", FOREST), ("rotors", RotorNavigation, "playground", PLAYGROUND)],
)
def test_a_flight_in_an_unseen_world_is_filmed(name, task, kind, world, tmp_path, monkeypatch):
    policy, out, names = tmp_path / "policy.zip", tmp_path / "made" / "film.webp", []
    envs = flockstep.DroneVectorEnv(4, task=task(), worlds=world)
    flockstep.PPO("MlpPolicy", envs, n_steps=4, batch_size=8, seed=0).save(policy)
    monkeypatch.setattr(films.flockstep.World, "load", lambda name: names.append(name) or world)
    films.main(films.Args(name, policy=policy, out=out, width_px=160, film_s=0.3))
    assert names[-1] == f"{kind}/seed-{UNSEEN_SEEDS.stop - 1}"
    with Image.open(out) as film:
        assert (film.n_frames, film.size) == (4, (160, 90))


def test_near_is_bright_and_pixels_stay_sharp():
    depth = np.full((12, 16), np.inf, np.float32)
    depth[3, 4], depth[5, 6] = 0.5, 10
    picture = np.asarray(films.depth_picture(depth, 50))
    assert picture.shape == (36, 48)
    assert picture[0, 0] == 0
    assert (picture[9:12, 12:15] == picture[9, 12]).all()
    assert picture[9, 12] > picture[15, 18] > 0


@pytest.mark.parametrize(
    ("name", "pictures", "size"),
    [
        ("dodge", 4, (64, 36)),
        ("swap", None, (64, 64)),
        ("formation", 2, None),
        ("street", 2, (64, 36)),
        ("flight", 3, (64, 36)),
        ("race", 3, (64, 36)),
    ],
)
def test_other_films_are_written(name, pictures, size, tmp_path, monkeypatch, capsys):
    out = tmp_path / "film.webp"
    monkeypatch.setattr(films.formation_film, "EVERY", 1)
    films.main(films.Args(name, out=out, width_px=64, film_s=0.1))
    with Image.open(out) as film:
        assert pictures is None or film.n_frames == pictures
        assert size is None or film.size == size
        assert film.info["loop"] == 0
    assert name not in ("flight", "race") or "success" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["flight", "race"])
def test_the_film_of_a_page_is_small(name):
    path = ROOT / "docs" / "images" / f"{name}.webp"
    assert path.stat().st_size < 1_000_000
    with Image.open(path) as film:
        assert (film.size, film.info["loop"]) == ((800, 450), 0)


def test_unknown_films_are_refused():
    with refused(SystemExit, "NAME", "dodgem"):
        films.main(films.Args("dodgem"))


def test_still_pictures_are_written_to_a_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(films.stills, "fly", lambda flight: np.zeros((4, 6, 3), np.uint8))
    monkeypatch.setattr(films.stills, "picture", lambda *_: np.zeros((4, 6, 3), np.uint8))
    films.main(films.Args("worlds", out=tmp_path / "made"))
    assert {path.name for path in (tmp_path / "made").iterdir()} == {
        *("forest.jpg", "office.jpg", "warehouse.jpg", "city.jpg"),
    }
    assert "worlds: in" in capsys.readouterr().out


# --- the flight through a playground


@pytest.fixture(scope="module")
def playground():
    return flockstep.World.playground(films.FILMS["flight"].seed, pillars=flight_film.PILLARS)


@pytest.fixture(scope="module")
def flight(playground):
    (one,) = fly(greedy(flockstep.policies.load("lidar")), [playground], MAX_STEPS)
    return one


@pytest.fixture(scope="module")
def content(playground, flight):
    return flight_film.shown(playground, flight.trail.astype(float))


def test_the_flight_succeeds_and_the_film_stays_close_to_it(playground, flight, content):
    assert flight.outcome == "success"
    gaps = np.linalg.norm(content.position[:, None] - flight.trail[None], axis=2)
    assert gaps.min(axis=1).max() < 0.2
    assert gaps.min(axis=0).max() < 0.2
    assert content.smoothed_m < 0.2
    assert (np.diff(content.reached) >= 0).all()
    assert content.reached[[0, -2, -1]].tolist() == [0, len(playground.waypoints), len(playground.waypoints) + 1]


def test_a_path_that_is_not_free_is_refused(playground):
    pillar = np.array(next(p for p in playground.primitives if p["kind"] == "cylinder")["center"])
    trail = pillar + np.linspace([-2, 0, 0], [2, 0, 0], 41)
    with refused(RuntimeError, "trail"):
        flight_film.shown(playground, trail)


def test_the_drone_is_where_it_projects_to(playground, content):
    scene = flight_film.Scene(playground, content.position, (400, 225))
    index = 60
    picture = np.asarray(scene.picture(content, index), int)
    moved = np.asarray(scene.picture(content, 0), int)
    rgb = np.zeros((225 * FINER, 400 * FINER, 3), np.uint8)
    canvas = flight_film.DepthCanvas(
        rgb, np.zeros(rgb.shape[:2], np.float32), scene.camera, scene.viewer, scene.turn, DARK_LIGHT
    )
    x, y, _ = canvas.project(content.position[[index]])[0] / FINER
    red, green, blue = picture.transpose(2, 0, 1)
    front = (red > 180) & (red > green + 60) & (green > blue + 30) & (picture != moved).any(axis=-1)
    rows, columns = np.nonzero(front)
    near = np.hypot(columns - x, rows - y) < 25
    assert near.sum() > 40  # the rotors in front
    assert columns[near].mean() > x + 2  # it faces +x, which is to the right


# --- the race


@pytest.fixture(scope="module")
def raced():
    return race_film.flown(flockstep.policies.load("race"), UNSEEN_SEEDS.start)


def test_the_policy_flies_three_laps(raced):
    gates = flockstep.World.load(race_film.TRACK).gates
    assert raced.success
    assert raced.passed[-1] == 3 * len(gates)
    start = raced.position[0] - gates[0]["center"]  # behind the first gate
    assert 0 < np.linalg.norm(start) < 2
    by_positions = 50 * np.linalg.norm(np.diff(raced.position, axis=0), axis=1)
    assert by_positions.max() == pytest.approx(raced.speed_mps.max(), rel=0.05)
    ends = race_film.lap_ends(raced, len(gates))
    assert len(ends) == 3
    assert [raced.passed[end] for end in ends] == [7, 14, 21]
    assert [raced.passed[end - 1] for end in ends] == [6, 13, 20]
    assert ends[-1] == len(raced.position) - 1


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


def test_the_drone_and_the_next_gate_are_where_they_project_to(raced):
    scene = race_film.Scene((640, 360))
    step = 60
    picture = np.asarray(scene.picture(raced, step), int)
    following = (raced.first + int(raced.passed[step])) % len(scene.gates)
    canvas = scene.canvas(raced, step)
    elsewhere = replace(raced, position=raced.position + np.array([0, 0, 50]))
    empty = scene.canvas(elsewhere, step).rgb.astype(int)
    (x, y, _), (gate_x, gate_y, _) = canvas.project(np.array([raced.position[step], scene.gates[following]["center"]]))
    rows, columns = np.nonzero((canvas.rgb != empty).any(axis=-1) & (picture != empty).any(axis=-1))
    assert np.hypot(columns - x, rows - y).min() < 4
    red, green, blue = empty.transpose(2, 0, 1)
    rows, columns = np.nonzero((green > red + 60) & (green > blue + 20))
    assert len(rows) > 50
    assert np.hypot(columns.mean() - gate_x, rows.mean() - gate_y) < 8


# --- stills


@pytest.mark.parametrize("name", ["forest", "office"])
def test_the_drone_is_shown_on_its_way(name, monkeypatch):
    """The trail is blue, and the rest of the picture does not depend on it."""
    image = stills.fly(stills.FLIGHTS[name], (160, 90)).astype(int)
    monkeypatch.setattr(third_person_view.ThirdPersonView, "_draw_trail", lambda *_: None)
    without = stills.fly(stills.FLIGHTS[name], (160, 90)).astype(int)
    trail = (image != without).any(axis=-1)
    assert trail.any()
    r, g, b = np.median(image[trail], axis=0)
    assert b > max(r, g)


# --- a fan as a slice: what is drawn agrees with what the LiDAR measures


@pytest.fixture(scope="module")
def scan():
    return Slice.scan()


def distances_along(origin, directions, segments):
    """Return the distance (K,) of the first segment (S, 2, 2) that each ray meets, inf if none."""
    p, q = segments[:, 0] - origin, segments[:, 1] - origin
    x, y = directions[:, None, 0], directions[:, None, 1]
    p_side, q_side = x * p[:, 1] - y * p[:, 0], x * q[:, 1] - y * q[:, 0]
    p_along, q_along = x * p[:, 0] + y * p[:, 1], x * q[:, 0] + y * q[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = p_along + (q_along - p_along) * p_side / (p_side - q_side)
    return np.where(((p_side >= 0) != (q_side >= 0)) & (t >= 0), t, np.inf).min(axis=1)


def test_the_hits_are_where_beams_meet_the_slice(scan):
    origin, ends, hit = beams_of(scan.batch, 0)
    ranges = np.where(hit, np.linalg.norm(ends - origin, axis=1), np.inf)
    directions = (ends - origin) / np.linalg.norm(ends - origin, axis=1)[:, None]
    first = distances_along(origin[:2], directions[:, :2], scan.cut)
    first[first > LIDAR.max_range_m] = np.inf
    np.testing.assert_allclose(ranges, first, atol=1e-4)
    assert 20 < hit.sum() < len(hit)


def test_no_box_within_range_and_sector_is_skipped(scan):
    kept = {tuple(segment.ravel()) for segment in scan.cut}
    skipped = np.array([segment for segment in scan.all_cut if tuple(segment.ravel()) not in kept])
    middle = skipped.mean(axis=1) - PLACE[:2]
    angle = (np.arctan2(middle[:, 1], middle[:, 0]) - scan.turns.mean() + np.pi) % (2 * np.pi) - np.pi
    inside = abs(angle) < np.deg2rad(LIDAR.hfov_deg) / 2
    assert np.linalg.norm(middle[inside], axis=1).min() > LIDAR.max_range_m


def test_it_is_drawn(tmp_path, scan):
    draw(tmp_path / "slice.webp", scan)
    assert (tmp_path / "slice.webp").stat().st_size > 50_000


SEED = UNSEEN_SEEDS.start + 5
POLICY = ROOT / "policies" / "track.zip"


def nothing(observation):
    """Command a plain hover."""
    return np.zeros((len(observation), 4), np.float32)


@pytest.fixture(scope="module")
def by_controller():
    return flown("track", track_film.controller(), SEED)


def test_both_fly_from_the_first_unseen_seed_and_are_filmed(tmp_path, monkeypatch, capsys):
    flights, seeds = [], []

    def noted(name, pilot, seed):
        seeds.append(seed)
        flights.append(flown(name, pilot, seed))
        return flights[-1]

    monkeypatch.setattr(track_film, "flown", noted)
    track_film.main(track_film.Args(policy=POLICY, out=tmp_path, flights=2, width_px=128, film_s=0.2))
    assert seeds == [UNSEEN_SEEDS.start] * 2  # with any result
    by_policy, by_controller = flights
    np.testing.assert_array_equal(by_policy.position[0], by_controller.position[0])
    np.testing.assert_allclose(by_policy.point, by_controller.point, atol=1e-6)
    assert np.abs(by_policy.position[100:] - by_controller.position[100:]).max() > 0.1
    assert "learned policy" in capsys.readouterr().out
    assert (tmp_path / "track.mp4").stat().st_size > 1000
    assert imageio.imread(tmp_path / "track.gif").shape == (3, 600, 800, 3)
    assert imageio.imread(tmp_path / "track.png").shape == (96, 128, 3)


def test_the_path_is_drawn_where_the_twin_says(by_controller, example):
    twin = example("track_numpy").Track(flockstep.TrackConfig())
    envs = begun(1, task=twin, seed=SEED)
    path = np.array([twin.path(envs.batch, step / 100)[0][0] for step in range(1001)])
    np.testing.assert_allclose(by_controller.point, path, atol=1e-5)

    scene = track_film.Scene(by_controller.point, (640, 240))
    red, green, blue = np.asarray(scene.picture(by_controller, 0), int).transpose(2, 0, 1)
    rows, columns = np.nonzero((green > red + 15) & (green > blue + 15))
    drawn = np.stack([columns, rows], axis=1) + 0.5
    canvas = scene._stage.seen_from(*scene._view)
    expected = canvas.project(path)[:, :2]
    apart = np.linalg.norm(drawn[:, None] - expected, axis=2)
    at_start = canvas.project(path[:1])[0, :2]  # the drone and the point are there
    assert (apart.min(axis=1) < 2)[np.linalg.norm(drawn - at_start, axis=1) > 20].all()
    assert (apart.min(axis=0) < 2)[np.linalg.norm(expected - at_start, axis=1) > 40].all()
    assert np.ptp(columns) > 0.7 * 640


def test_the_error_is_the_one_that_is_reported(by_controller):
    panel = track_film.Panel(track_film.Scene(by_controller.point, (64, 24)), by_controller, "", "")
    verdict = judge(TRAININGS["track"], track_film.controller(), 1, SEED)
    assert panel._error_m[-1] == pytest.approx(verdict.more["median_error_m"], abs=1e-5)
    assert panel._error_m[0] == pytest.approx(panel._distance_m[1], abs=1e-5)


def test_the_controller_is_the_one_that_is_reported():
    """bench/results/flight_train.json has 24.9 cm for 1,000 flights; the second best controller reaches 28 cm."""
    verdict = judge(TRAININGS["track"], track_film.controller(), 100, UNSEEN_SEEDS.start)
    assert verdict.more["median_error_m"] == pytest.approx(0.249, abs=0.01)


def test_a_flight_that_is_lost_stays_where_it_ended():
    """A plain hover command continues straight ahead; the drone is lost one metre from the point."""
    flight = flown("track", nothing, SEED)
    last = len(flight.point) - 1
    distance = np.linalg.norm(flight.point - flight.position, axis=1)
    assert flight.lost
    assert 10 < last < 1000
    assert (distance[:-1] <= 1).all()
    assert distance[-1] > 1
    panel = track_film.Panel(track_film.Scene(flight.point, (1280, 480)), flight, "", "")
    before, end, after = (np.asarray(panel.frame(step)) for step in (last - 1, last, 2000))
    np.testing.assert_array_equal(end, after)
    alarmed = [(picture[440:, :200] == ALARM).all(axis=-1).any() for picture in (before, end)]  # the caption
    assert alarmed == [False, True]


# --- a quadrotor that catches itself


def learn(max_minutes=None):
    """Train for four updates."""
    settings = {**TRAININGS["hover"].settings, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    return catch_film.learn(replace(TRAININGS["hover"], steps=256, num_envs=8, settings=settings), 0, max_minutes)


def test_the_policies_of_a_training_are_filmed(tmp_path):
    model, moments = learn()
    assert [moment.steps for moment in moments] == [0, 64, 128, 256]
    assert all(np.diff([moment.seconds for moment in moments]) > 0)
    assert not np.array_equal(moments[0].parameters, moments[3].parameters)
    last = model.learner.parameters
    np.testing.assert_array_equal(moments[3].parameters, last)

    rates = catch_film.draw(catch_film.Args(out=tmp_path, flights=2, width_px=128, film_s=0.2), model, moments)
    assert rates[0] == 0
    assert len(rates) == 4
    np.testing.assert_array_equal(model.learner.parameters, last)
    assert (tmp_path / "catch.mp4").stat().st_size > 1000
    assert imageio.imread(tmp_path / "catch.gif").shape == (2, 315, 560, 3)
    assert imageio.imread(tmp_path / "catch.png").shape == (900, 2000, 3)


def test_training_ends_when_its_time_is_up():
    _, moments = learn(max_minutes=0)
    assert [moment.steps for moment in moments] == [0, 0, 0, 8]


def test_a_policy_that_does_not_catch_is_called_a_failure(monkeypatch, tmp_path, capsys):
    model, moments = learn()
    monkeypatch.setattr(catch_film, "learn", lambda *_: (model, moments))
    args = catch_film.Args(out=tmp_path, flights=2, width_px=64, film_s=0.1)
    assert args.max_minutes is None
    assert not catch_film.main(args)
    text = capsys.readouterr().out
    assert "FAILED: time ran out at 256 of 307,200 steps. The policy did not learn to catch a quadrotor" in text
    assert "caught" not in text


def test_the_throw_is_the_most_tilted_one():
    seeds = range(UNSEEN_SEEDS.start, UNSEEN_SEEDS.start + 20)
    throws = [flown("hover", nothing, seed) for seed in seeds]
    up = [rotate(throw.quat_wxyz[0], np.array([0.0, 0.0, 1.0]))[2] for throw in throws]
    assert catch_film.most_tilted(seeds) == seeds[int(np.argmin(up))]


def test_a_throw_lasts_until_it_is_lost():
    """A plain hover command drifts to the side; the drone is lost 6 m from the point or at the floor below it."""
    throw = flown("hover", nothing, UNSEEN_SEEDS.start)
    point = catch_film.Scene((32, 18)).point
    distance = np.linalg.norm(throw.position - point, axis=1)
    assert throw.lost
    assert 10 < len(throw.position) == len(throw.quat_wxyz) < 301
    assert (distance[:-1] < 6).all()
    assert distance[-1] > 5.8
