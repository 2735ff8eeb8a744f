"""The film of a flight through a forest."""

import numpy as np
import pytest
from PIL import Image

import flockstep
from tools import forest_film
from training.forest_flight import ForestFlight
from training.tasks import UNSEEN_SEEDS


@pytest.fixture
def policy(tmp_path):
    envs = flockstep.DroneVectorEnv(4, task=ForestFlight(), worlds=flockstep.World.forest(0, trees=20, size_m=(30, 20)))
    flockstep.PPO("MlpPolicy", envs, n_steps=4, batch_size=8, seed=0).save(tmp_path / "policy.zip")
    return tmp_path / "policy.zip"


def test_a_flight_in_an_unseen_forest_is_filmed(policy, tmp_path, monkeypatch):
    seeds, grown = [], flockstep.World.forest(5, trees=20, size_m=(30, 20))
    monkeypatch.setattr(forest_film.flockstep.World, "forest", lambda seed: seeds.append(seed) or grown)
    out = tmp_path / "made" / "forest.webp"
    forest_film.main(forest_film.Args(policy=policy, out=out, width_px=160, steps=3))
    assert seeds[0] in UNSEEN_SEEDS
    with Image.open(out) as film:
        assert (film.n_frames, film.size) == (4, (160, 90))


def test_near_is_bright_and_pixels_stay_sharp():
    depth = np.full((12, 16), np.inf, np.float32)
    depth[3, 4], depth[5, 6] = 0.5, 10
    picture = np.asarray(forest_film.depth_picture(depth, 50))
    assert picture.shape == (36, 48)
    assert picture[0, 0] == 0
    assert (picture[9:12, 12:15] == picture[9, 12]).all()
    assert picture[9, 12] > picture[15, 18] > 0
