"""Films of flights."""

import imageio.v3 as imageio
import imageio_ffmpeg
import numpy as np
import pytest

import flockstep


@pytest.mark.parametrize("suffix", ["mp4", "gif"])
def test_a_film_has_a_picture_of_each_step(suffix, room, tmp_path):
    film = tmp_path / f"flight.{suffix}"
    seen = []

    def ahead(observation):
        seen.append(observation.shape)
        return np.zeros(1, int)

    count = flockstep.record(film, ahead, worlds=room, steps=6, render_view="top")
    assert count == 7
    assert seen == [(1, 38)] * 6
    if suffix == "mp4":
        assert imageio_ffmpeg.count_frames_and_secs(str(film)) == (count, pytest.approx(count / 20, abs=0.01))
        return
    pictures = imageio.imread(film)
    assert len(pictures) == count
    assert pictures[0].std() > 0
    assert (pictures[0] != pictures[-1]).any()


def test_a_film_ends_with_the_episode(closet, tmp_path):
    assert flockstep.record(tmp_path / "flight.gif", worlds=closet, max_episode_steps=3, render_view="top") == 4


def test_a_model_and_a_task_of_ones_own(room, tmp_path):
    class Model:
        def predict(self, observation, deterministic):
            assert deterministic
            return np.ones((1, 3), np.float32), None

    class Drift(flockstep.Task):
        observation_space = flockstep.task.spaces.Box(-1, 1, (1,), np.float32)

        def step(self, batch):
            return np.zeros(1), np.zeros(1, bool)

        def observe(self, batch):
            return np.zeros((1, 1), np.float32)

    assert flockstep.record(tmp_path / "flight.gif", Model(), Drift(), worlds=room, steps=2) == 3


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"path": "flight.avi"}, ValueError, "path: expected a name that ends with .mp4 or .gif, got 'flight.avi'"),
        ({"path": "flight.gif", "steps": 0}, ValueError, "steps: expected an integer >= 1, got 0"),
        ({"path": "flight.gif", "policy": 3}, TypeError, "policy: expected a model with predict"),
        ({"path": "flight.gif", "env": "CartPole-v1"}, TypeError, "unexpected keyword|expected an id of this package"),
    ],
)
def test_mistakes(arguments, error, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=said):
        flockstep.record(**arguments)
    assert list(tmp_path.iterdir()) == []
