"""Mistakes in tasks written in Python: each is named with the class and the method or attribute."""

import dataclasses

import numpy as np
import pytest
from conftest import world_of
from gymnasium import spaces
from messages import refused
from simple_tasks import Climb, Lapper

import flockstep

STILL = np.zeros((2, 3), np.float32)  # actions of both envs
FLIES = {"drone": "crazyflie", "dynamics": flockstep.DynamicsConfig(motion="rotors", control="velocity")}
MASKED = np.ma.array(np.zeros((2, 4)), mask=True)


def returns(value):
    """A method of any parameters that returns a value, or what a function makes of the batch."""
    return lambda self, batch, *_: value(batch) if callable(value) else value


def made(world, base=Climb, /, **members):
    return flockstep.DroneVectorEnv(2, worlds=world, task=type("Broken", (base,), members)())


def stepped(world, **members):
    env = made(world, **members)
    env.reset(seed=0)
    return env.step(STILL)


def step_of(reward=(0, 0), terminated=(False, False)):
    return {"step": returns((reward, terminated))}


def observed(space, given):
    return {"observation_space": space, "observe": returns(given)}


def box(dtype):
    return spaces.Box(0, 9, (4,), dtype)


@pytest.mark.parametrize(
    ("members", "said"),
    [
        (step_of(np.zeros(3)), ("Broken.step", "reward", (2,), (3,))),
        ({"step": returns({"reward": np.zeros(2)})}, ("Broken.step", "pair", "dict")),
        ({"step": returns((0, 1, 2, 3))}, ("Broken.step", "pair", "a tuple of 4")),
        ({"step": returns(None)}, ("Broken.step", "pair", None)),
        ({"act": returns(lambda batch: (batch.position, batch.quat_wxyz, 7))}, ("Broken.act", "a tuple of 3")),
        ({"act": returns(lambda batch: (batch.position,))}, ("Broken.act", "positions", "a tuple of 1")),
        ({"act": returns(None)}, ("Broken.act", "positions", None)),
        ({"act": returns(lambda batch: (None, batch.quat_wxyz))}, ("Broken.act", "positions", "a tuple of 2")),
        ({"act": returns(np.zeros((2, 4)))}, ("Broken.act", "positions", (2, 4), "control", "pose", "commands")),
        ({"act": returns(None)} | FLIES, ("Broken.act", "commands", None)),
        ({"observe": returns(lambda batch: batch.position)}, ("Broken.observe", (2, 4), (2, 3))),
        (step_of(np.ones(2) * 1j), ("Broken.step", "reward", "complex128")),
        (step_of(np.array([1, 2], "m8[s]")), ("Broken.step", "reward", "timedelta64[s]")),
        (step_of(np.array(["1", "2"])), ("Broken.step", "reward", "<U1")),
        (step_of(np.array([1, None])), ("Broken.step", "reward", "object")),
        (step_of(MASKED[:, 0]), ("Broken.step: reward", "mask")),
        (step_of(terminated=MASKED[:, 0] > 0), ("Broken.step: terminated", "mask")),
        ({"observe": returns(MASKED)}, ("Broken.observe", "mask")),
        ({"act": returns(MASKED[:, :3])}, ("Broken.act", "mask")),
        ({"act": returns((np.zeros((2, 3)), MASKED))}, ("Broken.act", "mask")),
        *(
            (step_of(terminated=flags), ("Broken.step", "terminated", bool, np.asarray(flags).dtype))
            for flags in ([0.0, 1.0], [0, 0.5], np.array([0, 1], np.float32), [0, 1], [np.nan, 0])
        ),
        *(
            (observed(box(dtype), np.ones((2, 4), got)), ("Broken.observe", np.dtype(dtype), np.dtype(got)))
            for dtype, got in ((np.uint8, np.float32), (np.uint8, np.int64), (np.int32, np.float64))
        ),
        *(
            (observed(box(dtype), np.full((2, 4), value, got)), ("Broken.observe", np.dtype(dtype), value))
            for dtype, got, value in (
                (np.int32, np.int64, 2**40),
                (np.int32, np.int64, -(2**31) - 1),
                (np.int64, np.uint64, 2**63),
            )
        ),
    ],
)
def test_what_methods_return(room, members, said):
    with refused(ValueError, *said):
        stepped(room, **members)


@pytest.mark.parametrize("name", ["success", "truncated"])
@pytest.mark.parametrize("value", [True, np.zeros(3, bool)])
def test_a_flag_of_a_wrong_shape(room, name, value):
    def step(self, batch):
        setattr(self, name, value)
        return np.zeros(2), np.zeros(2, bool)

    with refused(ValueError, "Broken.step", name, (2,), np.shape(value)):
        stepped(room, step=step)


def test_values_that_fit(room):
    for flags in ([False, True], np.array([False, True])):
        assert stepped(room, **step_of([1, 2], flags))[2].tolist() == [False, True]
    numbers = np.array([[0, 1, 2**31 - 1, -(2**31)]] * 2)
    env = made(room, **observed(spaces.Box(-(2**31), 2**31 - 1, (4,), np.int32), numbers))
    np.testing.assert_array_equal(env.reset(seed=0)[0], numbers)


ACTS = {"act": returns(lambda batch: batch.position)}


@pytest.mark.parametrize(
    ("kind", "members", "said"),
    [
        (TypeError, FLIES, ("Broken.act", "default act", "velocity")),
        *(
            (TypeError, {"action_space": space}, ("Broken.action_space", "default act"))
            for space in (spaces.Box(-1, 1, (4,)), spaces.Box(-1, 1, (2,)), spaces.Discrete(6))
        ),
        *(
            (TypeError, {name: value}, (f"Broken.{name}", advice))
            for name, value, advice in (
                ("policy_hz", 20, "write clock = flockstep.ClockConfig(policy_hz=...)"),
                ("control", "velocity", "write dynamics = flockstep.DynamicsConfig(control=...)"),
                ("wind", np.ones(3), "write dynamics = "),
                ("imu", flockstep.ImuConfig(), "give it to the env"),
                ("stagger_first_episode", True, "give it to the env"),
                ("pose_sensor", flockstep.PoseSensorConfig(), "give it to the env"),
            )
        ),
        (
            TypeError,
            {"control": "velocity", "dynamics": flockstep.DynamicsConfig(motion="rotors")},
            ("Broken.control", "write dynamics = "),
        ),
        (TypeError, {"observation_space": spaces.Dict(ids=box(np.uint16))}, ("observation_space: ids", "uint16")),
        (TypeError, {"observation_space": None}, ("Broken.observation_space", None)),
        *(
            (TypeError, {field: names}, (f"Broken.{field}",))
            for field in ("reward_terms", "info_names", "markers")
            for names in ("goal", 3, None, {"goal"}, ("goal", 3))
        ),
        *(
            (ValueError, {field: ["goal", "start", "goal"]}, (f"Broken.{field}", "twice", "goal"))
            for field in ("reward_terms", "info_names", "markers")
        ),
        (ValueError, {"reward_terms": ()}, ("Broken.reward_terms", ())),
        (ValueError, {"markers": ("start", "home")}, ("Broken.markers", "start", "home")),
        *(
            (ValueError, {"info_names": (name,)}, ("Broken.info_names", "taken", name))
            for name in ("success", "_hidden", "two words")
        ),
        (ValueError, {"observation_space": spaces.Box(-1, 1, (3, 0))} | ACTS, ("observation_space", "Box", (3, 0))),
        (ValueError, {"action_space": spaces.Box(-1, 1, (3, 0))} | ACTS, ("Broken.action_space", "Box", (3, 0))),
        *(
            (ValueError, {"max_episode_steps": limit}, ("max_episode_steps", 0, 2**31 - 1, limit))
            for limit in (2**31, 2**40, -1, True, 2.0, "9")
        ),
        (ValueError, {"frame_skip": 0}, ("frame_skip", 0)),
    ],
)
def test_what_a_class_declares(room, kind, members, said):
    with refused(kind, *said):
        made(room, **members)


def test_an_act_takes_any_space(room):
    for space in (spaces.Box(-1, 1, (4,)), spaces.Discrete(6)):
        made(room, action_space=space, **ACTS)


def test_own_names_that_are_keywords_elsewhere(room):
    class Own(Climb):
        policy_hz = 20  # for its own use; the env takes it from the clock
        clock = flockstep.ClockConfig(policy_hz=policy_hz)
        reward, action, observation = 3.0, None, "of its own"

        def __init__(self):
            self.control = "velocity"

        def friction(self):
            return 0.5

        @property
        def motion(self):
            return "kinematic"

    assert flockstep.DroneVectorEnv(2, worlds=room, task=Own).batch.clock.policy_hz == 20


@pytest.mark.parametrize(
    ("kind", "said", "step"),
    [
        (KeyError, ("lapse", "info_names", ("top", "laps")), lambda self, batch: self.info["lapse"]),
        (
            ValueError,
            ("Broken.info", "top, laps", "lops"),
            lambda self, batch: (setattr(self, "info", {"lops": np.zeros(2)}), self.flying),
        ),
        (
            ValueError,
            ("Broken.step", "shape"),
            lambda self, batch: (setattr(self, "info", dict.fromkeys(self.info, np.zeros(3))), self.flying),
        ),
    ],
)
def test_infos(room, kind, said, step):
    def reports(self, batch):
        step(self, batch)
        return np.zeros(2), np.zeros(2, bool)

    env = made(room, Lapper, reward_terms=("reward",), step=reports)
    env.reset(seed=0)
    with refused(kind, *said):
        env.step(STILL)


def test_a_limit_of_the_env_reaches_the_task(room):
    assert flockstep.DroneVectorEnv(2, worlds=room, task=Climb, max_episode_steps=5).task.max_episode_steps == 5
    assert flockstep.DroneVectorEnv(2, worlds=room, task=Climb).task.max_episode_steps == 12


def test_what_is_no_task_or_has_no_place(room):
    for task in (int, 3, "Climb"):
        with refused(TypeError, "task", "flockstep.Task"):
            flockstep.DroneVectorEnv(2, worlds=room, task=task)
    with refused(TypeError, "action"):
        flockstep.DroneVectorEnv(2, worlds=room, task=Climb(), action="discrete")
    bare = world_of(room={"min": [0, 0, 0], "max": [3, 3, 3]})
    with refused(ValueError, "start marker"):
        made(bare).reset(seed=0)
    with refused(NotImplementedError, "Nothing.observe"):
        task = type("Nothing", (flockstep.Task,), {"observation_space": Climb.observation_space})
        flockstep.DroneVectorEnv(2, worlds=room, task=task).reset(seed=0)


def test_an_observation_outside_its_space_warns_once(room):
    beyond = [0.0, 2.5, 3.5]  # of the first reset, the first step and a later one

    def observe(self, batch):
        place = np.zeros((2, 4))
        place[1, 3] = beyond.pop(0)
        return place.astype(np.float32)

    env = made(room, observation_space=spaces.Box(0, 1, (4,)), observe=observe)
    env.reset(seed=0)
    with refused(RuntimeWarning, "Broken.observe", 0.0, 1.0, 2.5, 1, [3]):
        env.step(STILL)
    env.step(STILL)  # not compared
    assert not beyond


def test_a_reset_that_begins_outside_the_room(room):
    def reset(self, batch, mask):
        batch.set_pose([[2, 4, 2], [20, 4, 2]], None, mask)

    with refused(ValueError, "reset: position", '"room"', "(8 8 4)", "(20  4  2)", 1):
        made(room, reset=reset).reset(seed=0)
    made(world_of(boxes=[{"center": [0, 0, 0], "size": [1, 1, 1]}]), reset=reset).reset(seed=0)


def test_a_reset_that_closes_its_env(room):
    opened = []
    env = made(room, reset=lambda self, batch, mask: opened.pop().close())
    opened.append(env)
    for said in ("the task closed this env", "this env is closed"):
        with refused(RuntimeError, said):
            env.reset(seed=0)


@pytest.mark.parametrize(
    ("control", "command", "said"),
    [
        ("attitude", [9.81, 45, 0, 0], ("roll", "degrees", 45)),
        ("attitude", [9.81, 0, -45, 0], ("pitch", "degrees", -45)),
        *((control, [1, 0, 0, 1e5], ("yaw",)) for control in ("attitude", "acceleration", "position")),
    ],
)
def test_an_act_whose_angles_are_in_degrees(room, control, command, said):
    dynamics = flockstep.DynamicsConfig(motion="rotors", control=control)
    with refused(ValueError, "act: command (row 1)", *said):
        stepped(room, dynamics=dynamics, act=returns(np.array([[0, 0, 0, 0], command], float)))


@pytest.mark.parametrize("quat", [(0, 0, 0, 0), (2, 0, 0, 0)])
def test_a_quaternion_that_is_not_unit(room, quat):
    with refused(ValueError, "act", "unit quaternions"):
        stepped(room, act=returns(lambda batch: (batch.position, np.tile(np.float32(quat), (2, 1)))))


@pytest.mark.parametrize(
    ("actions", "said"),
    [(np.zeros((2, 2)), (2, 3)), (np.full((2, 3), np.nan), "finite"), (np.full((2, 3), "x"), "floats")],
)
def test_bad_actions_change_nothing(room, actions, said):
    env = made(room)
    env.reset(seed=0)
    before = env.snapshot()
    with refused(ValueError, "actions", said):
        env.step(actions)
    assert env.snapshot() == before


@pytest.mark.parametrize(
    ("method", "call"),
    [
        ("step", lambda batch: batch.step(STILL)),
        ("picture", lambda batch: batch.picture(0)),
        ("set_light", lambda batch: batch.set_light(0, gamma=1.0)),
        ("set_light", lambda batch: batch.set_light(gamma=1.0)),
    ],
)
def test_calls_that_a_task_may_not_make(room, method, call):
    def step(self, batch):
        call(batch)

    camera = flockstep.CameraConfig(width_px=20, height_px=10)
    env = made(room, step=step, camera=camera)
    env.reset(seed=0)
    with refused(RuntimeError, f"{method}() was called by a task"):
        env.step(STILL)
    assert env.batch.world_of(0).light["gamma"] != 1.0


# Names that tasks may define for themselves.
OWN_NAMES = """
goal_radius target laps last_distance max_speed max_episode_time_s n_steps reward rewards action actions
action_scale action_dim action_shape observation observation_shape obs_dim state_size states loads draws acts resets
successes infos info_scale lidar_m lidar_range_m lidar_beams clock_s clock_hz camera_name drone_mass drone_kg
drone_ids world_size world_name step_ms step_s step_size steps_left flight flock block radar marker_ids frame frames
skip random_start random_seed dynamics_noise time_limit_s name num_episodes episode_steps max_reward
num_waypoints kp gains hold_s
"""


class TestMisspeltNames:
    """Names of a subclass that nearly match those of `Task`, and names that are its own."""

    @pytest.mark.parametrize(
        ("name", "meant"),
        [
            *(("max_episode_step", "max_episode_steps"), ("maxEpisodeSteps", "max_episode_steps")),
            *(("max_epsiode_steps", "max_episode_steps"), ("max_episodes_steps", "max_episode_steps")),
            *(("info_name", "info_names"), ("lidars", "lidar"), ("lidr", "lidar"), ("Lidar", "lidar")),
            *(
                ("world", "worlds"),
                ("wrolds", "worlds"),
                ("drones", "drone"),
                ("clocks", "clock"),
                ("marker", "markers"),
            ),
            *(("action_spaces", "action_space"), ("frameskip", "frame_skip"), ("random_worlds", "random_world")),
            *(("max_steps", "max_episode_steps"), ("episode_length", "max_episode_steps")),
            *(("max_ep_steps", "max_episode_steps"), ("act_space", "action_space")),
            *(("reward_term", "reward_terms"), ("dynamic", "dynamics"), ("stepm", "step_m"), ("Step_M", "step_m")),
        ],
    )
    @pytest.mark.parametrize("on_the_class", [True, False])
    def test_attributes(self, room, name, meant, on_the_class):
        members = {"observation_space": Climb.observation_space, "step": Climb.step, "observe": Climb.observe}
        if on_the_class:
            members[name] = 3
        else:
            members["__init__"] = lambda self: setattr(self, name, 3)
        with refused(TypeError, f"Broken.{name}", meant):
            made(room, flockstep.Task, **members)

    @pytest.mark.parametrize(
        ("name", "method", "meant"),
        [
            ("Reset", lambda self, batch, mask: None, "reset"),
            ("rest", lambda self, batch, mask: None, "reset"),
            ("set_up", lambda self, batch: None, "setup"),
            ("setUp", lambda self, batch: None, "setup"),
            ("Act", lambda self, batch, actions: None, "act"),
            ("Draw", lambda self, batch, env, drawing: None, "draw"),
            ("State", lambda self: {}, "state"),
            ("Reset", staticmethod(lambda batch, mask: None), "reset"),
        ],
    )
    def test_methods(self, room, name, method, meant):
        members = {"observation_space": Climb.observation_space, "step": Climb.step, "observe": Climb.observe}
        with refused(TypeError, f"Broken.{name}", meant):
            made(room, flockstep.Task, **members, **{name: method})

    def test_names_of_its_own(self, room):
        methods = {
            "distance": lambda self, batch: 0,
            "states": lambda self: {},
            "actor": lambda self, batch: 0,
            "observed": lambda self, batch: 0,
            "observation_of": lambda self, batch: 0,
            "drawn": lambda self, batch: 0,
            "reset_goal": lambda self, batch, mask: 0,
            "stepped": lambda self, batch: 0,
            "start": lambda self, batch, mask: 0,
            "react": lambda self, batch: 0,
            "camera_of": lambda self, batch: 0,
            "worlds_of": staticmethod(lambda seed: 0),
            "loaded": classmethod(lambda cls: 0),
            "lidars": property(lambda self: 0),
            "Lidar": type("Lidar", (), {}),
            "_reset": lambda self, batch, mask: 0,
            "_max_episode_step": 3,
        }

        needed = {
            "observation_space": spaces.Box(-9, 9, (3,), np.float32),
            "step": lambda self, batch: (np.zeros(2), np.zeros(2, bool)),
            "observe": lambda self, batch: batch.position,
        }
        task = type("Own", (flockstep.Task,), {**dict.fromkeys(OWN_NAMES.split(), 1), **methods, **needed})
        task.squash, task.largest = np.tanh, staticmethod(max)  # Python cannot count the parameters of these
        flockstep.DroneVectorEnv(2, worlds=room, task=task).reset(seed=0)
        # A name is also accepted if the task has the other name, or once setup has begun.
        both = {"world": room, "worlds": room, "setup": lambda self, batch: setattr(self, "lidars", 3)}
        flockstep.DroneVectorEnv(2, task=type("Both", (flockstep.Task,), {**needed, **both})).reset(seed=0)

    def test_a_dataclass(self, room):
        @dataclasses.dataclass(eq=False)
        class Wide(Climb):
            goal_radius: float = 1.0
            steps_per_goal: int = 3

        assert flockstep.DroneVectorEnv(2, worlds=room, task=Wide(2.0)).task.goal_radius == 2
        wrong = dataclasses.make_dataclass("Wrong", [("reward_term", str, "a")], bases=(Climb,), eq=False)
        with refused(TypeError, "Wrong.reward_term", "reward_terms"):
            flockstep.DroneVectorEnv(2, worlds=room, task=wrong())
