"""The table of films: each row flies in an unseen world and writes its film."""

import numpy as np
import pytest
from messages import refused
from PIL import Image

import flockstep
from flockstep.trainings import UNSEEN_SEEDS
from tools import films
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
    [("dodge", 4, (64, 36)), ("swap", None, (64, 64)), ("formation", 2, None), ("street", 2, (64, 36))],
)
def test_other_films_are_written(name, pictures, size, tmp_path, monkeypatch):
    out = tmp_path / "film.webp"
    monkeypatch.setattr(films.formation_film, "EVERY", 1)
    films.main(films.Args(name, out=out, width_px=64, film_s=0.1))
    with Image.open(out) as film:
        assert pictures is None or film.n_frames == pictures
        assert size is None or film.size == size
        assert film.info["loop"] == 0


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
