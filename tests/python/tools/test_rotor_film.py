"""The films of flights with rotors through a forest and past pillars."""

import numpy as np
import pytest
from PIL import Image

import flockstep
from tools import rotor_film
from training.forest_flight import ForestFlight
from training.rotor_navigation import RotorNavigation
from training.tasks import UNSEEN_SEEDS

FOREST = flockstep.World.forest(0, trees=20, size_m=(30, 20))
PLAYGROUND = flockstep.World.load("playground/train-1")


@pytest.mark.parametrize(
    ("name", "task", "kind", "world"),
    [("forest", ForestFlight, "forest", FOREST), ("lidar_rotors", RotorNavigation, "playground", PLAYGROUND)],
)
def test_a_flight_in_an_unseen_world_is_filmed(name, task, kind, world, tmp_path, monkeypatch):
    policy, out, seeds = tmp_path / "policy.zip", tmp_path / "made" / "film.webp", []
    envs = flockstep.DroneVectorEnv(4, task=task(), worlds=world)
    flockstep.PPO("MlpPolicy", envs, n_steps=4, batch_size=8, seed=0).save(policy)
    monkeypatch.setattr(rotor_film.flockstep.World, kind, lambda seed: seeds.append(seed) or world)
    rotor_film.main(rotor_film.Args(name, policy=policy, out=out, width_px=160, steps=3))
    assert seeds[0] in UNSEEN_SEEDS
    with Image.open(out) as film:
        assert (film.n_frames, film.size) == (4, (160, 90))


def test_near_is_bright_and_pixels_stay_sharp():
    depth = np.full((12, 16), np.inf, np.float32)
    depth[3, 4], depth[5, 6] = 0.5, 10
    picture = np.asarray(rotor_film.depth_picture(depth, 50))
    assert picture.shape == (36, 48)
    assert picture[0, 0] == 0
    assert (picture[9:12, 12:15] == picture[9, 12]).all()
    assert picture[9, 12] > picture[15, 18] > 0
