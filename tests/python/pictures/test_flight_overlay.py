"""Pictures of the built-in tasks, and selected envs."""

import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused

import flockstep
from flockstep.pictures.flight_overlay import FlightOverlay, GoalOverlay, PlaceOverlay, RaceOverlay

TASKS = pytest.mark.parametrize("config", [flockstep.HoverConfig, flockstep.TrackConfig])


class Notes:
    """A drawing that stores all calls."""

    def __init__(self):
        self.drawn = {}

    def lines(self, starts, ends, color, width):
        name = "line" if np.ndim(starts) == 1 else "outline"
        self.drawn[color, name] = np.array([starts, ends])

    def points(self, positions, color, size):
        self.drawn[color, "point"] = np.array(positions)

    def spheres(self, centers, radius_m, color):
        self.drawn[color, "sphere"] = np.array(centers)

    def text(self, position, string, color, size):
        self.drawn["text"] = string


def noted(envs, overlay=FlightOverlay, row=0, **arguments):
    notes = Notes()
    overlay(**arguments).draw(envs.batch, row, notes)
    return notes.drawn


def flown(config, steps=10, num_envs=1, **keywords):
    envs = begun(num_envs, task=config, render_mode="rgb_array", **keywords, seed=3)
    envs.action_space.seed(3)
    for _ in range(steps):
        envs.step(envs.action_space.sample())
    return envs


@TASKS
def test_flights_are_seen_from_behind_unless_a_view_is_chosen(config):
    envs = flown(config())
    (picture,) = envs.render()
    assert picture.shape == (480, 640, 3)
    explicit = flown(config(), render_view="third_person").render()[0]
    assert (picture == explicit).all()
    assert flown(config(), render_view="top").render()[0].shape == (256, 256, 3)
    assert flockstep.DroneVectorEnv(1, render_mode="rgb_array").render()[0].shape == (256, 256, 3)
    single = flockstep.DroneEnv(task=config(), render_mode="rgb_array")
    single.reset(seed=0)
    assert single.render().shape == (480, 640, 3)


@TASKS
@pytest.mark.parametrize("view", ["top", "third_person", ((-5, -2, 7), (-3, 0, 6))])
def test_the_start_marker_that_no_flight_uses_is_not_drawn(config, view):
    hall = flockstep.World.load("arena/hall")
    bare = hall.to_dict()
    del bare["markers"]["start"]
    pictures = [
        flown(config(), 1, worlds=world, render_view=view).render()[0]
        for world in (hall, flockstep.World.from_dict(bare))
    ]
    assert hall.start is not None
    assert (pictures[0] == pictures[1]).all()


def test_hover_shows_its_point_and_the_height():
    envs = flown(flockstep.HoverConfig())
    position, drawn = envs.batch.position[0], noted(envs)
    np.testing.assert_allclose(drawn["green", "point"], envs.batch.world_of(0).goal, atol=1e-5)
    np.testing.assert_allclose(drawn["green", "sphere"], envs.batch.world_of(0).goal, atol=1e-5)
    np.testing.assert_allclose(drawn["green", "line"][0], position)
    np.testing.assert_allclose(
        drawn["grey", "line"], [position, [*position[:2], 0]], atol=0.01
    )  # the picture has lines
    assert drawn["text"] == f"{position[2]:.1f} m"
    assert not any("grey" in key for key in noted(envs, height=False))


def test_track_shows_where_its_path_is():
    envs = flown(flockstep.TrackConfig(start_offset_m=0), steps=0)
    np.testing.assert_allclose(noted(envs)["green", "point"], envs.batch.position[0], atol=1e-5)
    before = noted(envs)["green", "point"]
    envs.step(np.zeros((1, 4), np.float32))
    assert 0 < np.linalg.norm(noted(envs)["green", "point"] - before) < 0.1


@pytest.mark.parametrize("shape", ["square", "ring"])
def test_race_shows_its_next_gate_and_the_speed(shape):
    turned = {"quat_wxyz": [0.5**0.5, 0, 0, 0.5**0.5], "shape": shape, "size": 1.8}  # is passed along y
    world = world_of(gates=[{"center": [0, 0, 5]}, {"center": [8, 0, 5], **turned}])
    envs = flown(flockstep.RaceConfig(start="gate"), steps=0, worlds=world)
    while envs.batch.task_state["target"][0] != 1:
        envs.reset()
    envs.batch.set_velocity(np.float32([[3, 4, 12]]))
    drawn = noted(envs, RaceOverlay)
    np.testing.assert_allclose(drawn["green", "line"], [envs.batch.position[0], [8, 0, 5]], atol=1e-5)
    np.testing.assert_allclose(drawn["green", "point"], [8, 0, 5])
    outline = drawn["green", "outline"]
    np.testing.assert_array_equal(outline[0, 1:], outline[1, :-1])
    np.testing.assert_allclose(outline[0, 0], outline[1, -1])
    offset = outline[0] - [8, 0, 5]
    np.testing.assert_allclose(offset[:, 1], 0, atol=1e-6)
    if shape == "square":
        np.testing.assert_allclose(
            sorted(map(tuple, offset[:, ::2].round(6))), [(x, z) for x in (-0.9, 0.9) for z in (-0.9, 0.9)]
        )
    else:
        np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 0.9, rtol=0.01)
    assert drawn["text"] == "13 m/s"


def test_race_is_drawn_in_every_view():
    world = flockstep.World.load("race/figure-8")
    for view in ("top", "third_person", ((-10.5, -8.5, 7.5), (0, 0, 3))):
        envs = flown(flockstep.RaceConfig(), 0, worlds=world, render_view=view)
        (before,) = envs.render()
        envs.batch.set_velocity(np.float32([[9, 0, 0]]))
        assert (envs.render()[0] != before).any()  # the speed
        assert (np.abs(before.astype(int) - [52, 160, 80]).max(axis=-1) < 12).any()  # the next gate, green


def test_dodge_shows_its_goal_and_no_marker():
    world = flockstep.World.playground(seed=1, movers=3)
    envs = flown(flockstep.DodgeConfig(), 1, worlds=world)
    drawn, goal = noted(envs, GoalOverlay), envs.batch.task_state["goal"][0]
    assert np.linalg.norm(goal - world.goal) > 1
    np.testing.assert_array_equal(drawn["green", "sphere"], goal)
    np.testing.assert_allclose(drawn["green", "line"], [envs.batch.position[0], goal])
    assert drawn["grey", "point"].size == 0
    bare = world.to_dict()
    for name in ("waypoints", "goal"):
        del bare["markers"][name]
    twin = flown(flockstep.DodgeConfig(), 1, worlds=flockstep.World.from_dict(bare))
    assert (envs.render()[0] == twin.render()[0]).all()


def test_swap_shows_the_goals_of_the_shown_drone_and_of_the_others():
    envs = flown(flockstep.SwapConfig(jitter_m=0), 0, num_envs=2, drones_per_env=4)
    starts = envs.batch.position
    drawn = noted(envs, GoalOverlay, row=6)
    np.testing.assert_allclose(drawn["green", "point"], starts[4], atol=1e-5)  # the opposite place
    np.testing.assert_allclose(drawn["grey", "point"], starts[[6, 7, 5]], atol=1e-5)


def test_formation_shows_the_place():
    envs = flown(flockstep.FormationConfig(jitter_m=0), 0)
    np.testing.assert_allclose(noted(envs, PlaceOverlay, row=2)["green", "point"], envs.batch.position[2], atol=1e-5)
    envs.batch.set_pose(np.add(envs.batch.position, [0.5, 0, 0]))
    places = envs.batch.position - [0.5, 0, 0]
    envs.step(np.zeros((4, 3), np.float32))
    assert np.linalg.norm(noted(envs, PlaceOverlay)["green", "point"] - places[0]) < 0.2  # it has moved by a step
    envs.batch.set_pose(np.add(envs.batch.position, [2.4, 0, 0]))
    envs.step(np.zeros((4, 3), np.float32))
    assert noted(envs, PlaceOverlay) == {}


def test_some_envs_are_drawn(closet):
    envs = begun(5, worlds=closet, render_mode="rgb_array", random_start=True, seed=1)
    envs.step(np.arange(5))
    every = envs.render()
    assert len(every) == 5
    assert any((picture != every[0]).any() for picture in every)
    for indices in ([3, 1], np.array([4]), (), range(2)):
        some = envs.render(indices=indices)
        assert len(some) == len(indices)
        assert all((picture == every[i]).all() for picture, i in zip(some, indices, strict=True))
    assert len(envs.render(2)) == 1
    for wrong in (5, -1, [0, 5], [0.5], [True], ["a"]):
        with refused(ValueError, "indices"):
            envs.render(wrong)
    with refused(UserWarning, "for pictures"):
        assert flockstep.DroneVectorEnv(5, worlds=closet).render([0]) is None


def test_without_pillow_there_is_no_label(monkeypatch):
    monkeypatch.setattr("flockstep.pictures.flight_overlay.find_spec", lambda name: None)
    for config, overlay in ((flockstep.HoverConfig(), FlightOverlay), (flockstep.RaceConfig(), RaceOverlay)):
        drawn = noted(flown(config), overlay)
        assert ("green", "line") in drawn
        assert "text" not in drawn
