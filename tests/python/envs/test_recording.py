"""Films of flights."""

import gymnasium
import imageio.v3 as imageio
import imageio_ffmpeg
import numpy as np
import pytest
from conftest import begun
from gymnasium import spaces
from messages import refused
from simple_tasks import Still

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
        assert imageio_ffmpeg.count_frames_and_secs(str(film)) == (count, pytest.approx(count / 10, abs=0.01))
        return
    pictures = imageio.imread(film)
    assert len(pictures) == count
    assert pictures[0].std() > 0
    assert (pictures[0] != pictures[-1]).any()


@pytest.mark.parametrize("suffix", ["mp4", "gif"])
def test_an_interrupted_film_leaves_what_was_there(suffix, room, tmp_path):
    film = tmp_path / f"flight.{suffix}"
    film.write_bytes(b"before")
    left = iter([0, 0])

    def interrupted(observation):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return np.zeros(1, int)

    with pytest.raises(KeyboardInterrupt):
        flockstep.record(film, interrupted, worlds=room, steps=6, render_view="top")
    assert film.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [film]


@pytest.mark.parametrize(
    ("keywords", "fps"),
    [
        ({}, 10),
        ({"frame_skip": 2}, 5),
        ({"frame_skip": 3, "policy_hz": 50}, 17),
        ({"policy_hz": 0.2}, 1),
        ({"fps": 25, "policy_hz": 50}, 25),
    ],
)
def test_a_film_is_as_fast_as_the_flight(keywords, fps, room, tmp_path):
    count = flockstep.record(tmp_path / "flight.mp4", worlds=room, steps=6, render_view="top", **keywords)
    assert imageio.immeta(tmp_path / "flight.mp4")["fps"] == fps
    flockstep.record(tmp_path / "flight.gif", worlds=room, steps=6, render_view="top", **keywords)
    assert imageio.immeta(tmp_path / "flight.gif")["duration"] == pytest.approx(1000 / fps, abs=10)
    assert count == 7


def test_films_of_gymnasium_are_as_fast_as_the_flight(room):
    for envs in (
        flockstep.DroneVectorEnv(2, worlds=room, policy_hz=50, frame_skip=2),
        gymnasium.make(ENV_ID, worlds=room, policy_hz=50, frame_skip=2),
        flockstep.sb3.make_vec(ENV_ID, worlds=room, policy_hz=50, frame_skip=2),
    ):
        assert envs.metadata["render_fps"] == 25
    assert flockstep.DroneVectorEnv.metadata["render_fps"] == 10  # not changed by the env above


def test_a_model_of_another_task_is_refused(room, tmp_path):
    class Model:
        observation_space = spaces.Box(-1, 1, (11,), np.float32)
        action_space = spaces.Discrete(6)

        def predict(self, observation, deterministic):
            return np.zeros(1, int), None

    with refused(ValueError, "record", "Box(11,)", "flockstep/LidarNavigation-v0", "Box(38,)"):
        flockstep.record(tmp_path / "flight.gif", Model(), worlds=room)
    Model.observation_space = Lucky.observation_space
    with refused(ValueError, "record", "Discrete(6)", "Lucky", "Box(3,)"):
        flockstep.record(tmp_path / "flight.gif", Model(), Lucky, worlds=room)
    assert list(tmp_path.iterdir()) == []


def test_a_film_ends_with_the_episode(closet, tmp_path):
    assert flockstep.record(tmp_path / "flight.gif", worlds=closet, max_episode_steps=3, render_view="top") == 4


class Ends(Still):
    """Drone m of an env ends after 2 m + 2 steps; all but the last succeed, or all if `all_succeed`."""

    all_succeed = False

    def step(self, batch):
        member = np.arange(batch.num_drones) % batch.drones_per_env
        over = self.steps >= 2 * member + 2
        self.success[:] = over & (self.all_succeed | (member < batch.drones_per_env - 1))
        return np.zeros(batch.num_drones), over


@pytest.mark.parametrize(("episodes", "pictures"), [("team", 3), ("each", 7), ("last", 7)])
def test_a_film_of_several_drones_ends_with_the_last_of_them(episodes, pictures, room, tmp_path):
    shapes = set()

    def still(observation):
        shapes.add(observation.shape)
        return np.zeros((len(observation), 3), np.float32)

    keywords = {"worlds": room, "drones_per_env": 3, "episodes": episodes, "render_size": (64, 48)}
    assert flockstep.record(tmp_path / "a.gif", still, Ends, **keywords) == pictures
    assert shapes == {(3, 3)}
    succeeding = Ends()
    succeeding.all_succeed = True
    if episodes == "team":  # the first end cuts the others off, which have not succeeded
        with refused(RuntimeError, "until_success", "none of the episodes"):
            flockstep.record(tmp_path / "b.gif", still, succeeding, until_success=2, **keywords)
        return
    with refused(RuntimeError, "until_success", "none of the episodes"):
        flockstep.record(tmp_path / "b.gif", still, Ends, until_success=2, **keywords)
    assert flockstep.record(tmp_path / "b.gif", still, succeeding, until_success=2, **keywords) == pictures


def test_a_film_shows_the_other_drones_of_the_env(room):
    keywords = {"worlds": room, "render_mode": "rgb_array", "render_size": (64, 48)}
    for drones in (1, 2):
        frames = []
        for view in ("fleet", "third_person"):
            envs = begun(1, drones_per_env=drones, render_view=view, **keywords)
            envs.batch.set_pose(np.float32([[1, 1, 1], [2.5, 1, 1]])[:drones])
            frames.append(envs.render()[0])
        assert (frames[0] != frames[1]).any() == (drones == 2)


def test_a_model_and_a_task_of_ones_own(room, tmp_path):
    class Model:
        def predict(self, observation, deterministic):
            assert deterministic
            return np.ones((1, 3), np.float32), None

    assert flockstep.record(tmp_path / "flight.gif", Model(), Still(), worlds=room, steps=2) == 3


def test_a_film_shows_its_progress(room, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(flockstep.progress_line, "_INTERVAL_S", 0.0)
    film = tmp_path / "a.gif"
    keywords = {"worlds": room, "steps": 2, "render_view": "top"}
    flockstep.record(film, **keywords)
    out, lines = capsys.readouterr()
    assert not out
    assert [line.rpartition(",")[0] for line in lines.splitlines()] == [
        *(f"{film}: {count} of at most 3 images" for count in (1, 2, 3)),
        f"{film}: 3 images",
    ]
    flockstep.record(film, quiet=True, **keywords)
    with refused(RuntimeError, "until_success", "none of the episodes"):
        flockstep.record(film, quiet=True, until_success=2, **keywords)
    assert capsys.readouterr() == ("", "")
    with refused(RuntimeError, "until_success", "none of the episodes"):
        flockstep.record(film, until_success=2, **keywords)
    assert "1 of at most 2 episodes without a success, 0 s\n" in capsys.readouterr().err


class Remembering:
    """A model whose state is the number of observations of the episode; it keeps what it was given."""

    def __init__(self):
        self.given = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        count = np.zeros(len(observation), int) if state is None else state[0]
        count = np.where(episode_start, 0, count) + 1
        self.given.append((count.tolist(), deterministic))
        return np.zeros((len(observation), 3), np.float32), (count,)


def test_a_model_gets_its_state_back_until_an_episode_ends(room, tmp_path):
    model = Remembering()
    flockstep.record(tmp_path / "a.gif", model, Ends, worlds=room, steps=9, render_size=(64, 48))
    assert model.given == [([1], True), ([2], True)]
    ending = Ends()
    ending.all_succeed = True
    flockstep.record(tmp_path / "b.gif", model, ending, worlds=room, until_success=2, render_size=(64, 48))
    assert model.given[2:] == model.given[:2]
    model = Remembering()
    flockstep.evaluate(model, Ends, episodes=2, worlds=room, drones_per_env=2, drone_episodes="each")
    assert [count for count, _ in model.given] == [[1, 1, 1, 1], [2, 2, 2, 2], [1, 3, 1, 3], [2, 4, 2, 4]]


def test_a_predict_with_other_arguments_is_refused(room, tmp_path):
    class Masked(Remembering):
        def predict(self, observation, action_masks, deterministic=False):
            raise AssertionError

    class Forgetful(Remembering):
        def predict(self, observation):
            return np.zeros((len(observation), 3), np.float32), (observation,)

    class Single(Remembering):
        def predict(self, observation, **_):
            return np.zeros((len(observation), 3), np.float32)

    for model, said in (
        (Masked(), ("Masked.predict", "action_masks")),
        (Forgetful(), ("Forgetful.predict", "a state")),
        (Single(), ("Single.predict", "(actions, state)", "ndarray")),
    ):
        with refused(TypeError, "evaluate", *said):
            flockstep.evaluate(model, Ends, episodes=2, worlds=room)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"path": "flight.avi"}, ("path", ".mp4", ".gif", "flight.avi")),
        ({"steps": 0}, ("steps", 0)),
        ({"until_success": 0}, ("until_success", 0)),
        ({"until_success": True}, ("until_success", True)),
        ({"policy": 3}, ("policy", 3)),
        ({"policy": "policy.zip"}, ("policy", "policy.zip")),
        ({"env": "CartPole-v1"}, ("CartPoleVectorEnv.__init__()",)),
    ],
)
def test_mistakes(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused((ValueError, TypeError), *said):
        flockstep.record(**{"path": "flight.gif"} | arguments)
    assert list(tmp_path.iterdir()) == []


class Lucky(Still):
    """Ends after 1 to 5 steps, drawn from its first random number; a success after 4 steps forward."""

    def step(self, batch):
        limit = 1 + (5 * batch.random(stream=0, count=1)[:, 0]).astype(int)
        over = batch.steps >= limit
        self.success[:] = over & (limit == 4) & (batch.position[:, 0] > 2.35)
        return np.zeros(1), over

    def draw(self, batch, env, drawing):
        self.drawn = True


def ahead(observation):
    return np.float32([[1, 0, 0]])


def first_lucky_seed(room):
    envs = begun(30, worlds=room, task=Lucky, seed=7)
    return 7 + np.flatnonzero((5 * envs.batch.random(stream=0, count=1)[:, 0]).astype(int) == 3)[0]


def test_the_first_episode_that_succeeds_is_filmed(room, tmp_path):
    lucky = first_lucky_seed(room)
    assert lucky > 7
    keywords = {"worlds": room, "seed": 7, "render_view": "top"}
    count = flockstep.record(tmp_path / "a.gif", ahead, Lucky, until_success=lucky - 6, **keywords)
    assert count == 5
    keywords["seed"] = lucky
    assert flockstep.record(tmp_path / "b.gif", ahead, Lucky, **keywords) == 5
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_without_success_there_is_no_film(room, tmp_path):
    lucky, task = first_lucky_seed(room), Lucky()
    keywords = {"worlds": room, "seed": 7, "render_view": "top"}
    with refused(RuntimeError, "until_success", f"seeds 7 to {lucky - 1}", 400):
        flockstep.record(tmp_path / "a.gif", ahead, task, until_success=lucky - 7, **keywords)
    with refused(RuntimeError, "until_success", f"seeds 7 to {lucky}", 3):
        flockstep.record(tmp_path / "a.gif", ahead, Lucky, until_success=lucky - 6, steps=3, **keywords)
    assert list(tmp_path.iterdir()) == []
    assert not hasattr(task, "drawn")  # trial episodes draw no pictures


def test_a_task_that_does_not_repeat_is_reported(room, tmp_path):
    class Once(Lucky):
        tries = 0

        def reset(self, batch, mask):
            super().reset(batch, mask)
            self.tries += 1

        def step(self, batch):
            self.success[:] = self.tries == 1
            return np.zeros(1), np.ones(1, bool)

    with refused(RuntimeError, "until_success", "seed 3", "replay"):
        flockstep.record(tmp_path / "a.gif", ahead, Once, worlds=room, seed=3, until_success=1, render_view="top")


ENV_ID = "flockstep/LidarNavigation-v0"
PICTURES = {"render_mode": "rgb_array", "render_view": "top", "render_size": (96, 64)}


def frames_and_size(folder):
    """Number of frames and size of the only film in a folder."""
    (film,) = folder.glob("*.mp4")
    reader = imageio_ffmpeg.read_frames(str(film))
    size = next(reader)["size"]
    reader.close()
    return imageio_ffmpeg.count_frames_and_secs(str(film))[0], size


def test_a_view_and_a_size_are_chosen_for_a_film(room, tmp_path):
    place = {"render_view": ((1, 1, 3), (5, 5, 1)), "render_size": (150, 90)}
    assert flockstep.record(tmp_path / "flight.mp4", worlds=room, steps=2, **place) == 3
    assert frames_and_size(tmp_path) == (3, (150, 90))


def by_gymnasium(room, folder):
    env = gymnasium.make(ENV_ID, worlds=room, max_episode_steps=5, **PICTURES)
    env = gymnasium.wrappers.RecordVideo(env, folder, episode_trigger=lambda episode: episode == 0)
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(0)
        ended = terminated or truncated
    env.close()


def by_gymnasium_side_by_side(room, folder):
    envs = gymnasium.make_vec(ENV_ID, 3, worlds=room, **PICTURES)
    envs = gymnasium.wrappers.vector.RecordVideo(envs, folder, step_trigger=lambda step: step == 1, video_length=4)
    envs.reset(seed=0)
    for _ in range(6):
        envs.step([0, 0, 0])
    envs.close()


def by_stable_baselines(room, folder):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    vec = flockstep.sb3.make_vec(ENV_ID, 2, worlds=room, **PICTURES)
    vec = vec_env.VecVideoRecorder(vec, folder, lambda step: step == 0, video_length=4)
    vec.reset()
    for _ in range(6):
        vec.step(np.zeros(2, int))
    vec.close()


@pytest.mark.parametrize(
    ("film", "found"),
    [
        (by_gymnasium, (6, (96, 64))),
        (by_gymnasium_side_by_side, (5, (3 * 96, 64))),
        (by_stable_baselines, (5, (96, 2 * 64))),
    ],
)
def test_recorders_of_others(film, found, room, tmp_path):
    film(room, str(tmp_path / "films"))
    assert frames_and_size(tmp_path / "films") == found
