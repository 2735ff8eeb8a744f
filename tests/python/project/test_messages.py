"""The exact words of messages: one of each kind. Other tests name only the field and the values of a message.

Each is the call in a line, and then the error as Python shows it. After a change of words, look at what the failure
shows, and write it here.
"""

import itertools
import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import ROOT, world_of
from gymnasium import spaces
from messages import message
from simple_tasks import Still

import flockstep

ROOM = world_of(room={"min": [0, 0, 0], "max": [9, 9, 9]})
HOME = ROOM.with_drawn_markers(0)


def made(num_envs: int = 2, **keywords: Any) -> flockstep.DroneVectorEnv:
    return flockstep.DroneVectorEnv(num_envs, **{"worlds": HOME} | keywords)


def stepped(actions: Any = None, **members: Any) -> None:
    """Step a task with other members: plain values, or what its methods return."""
    given = {
        name: (lambda *_, value=value: value) if name in ("step", "observe", "act") else value
        for name, value in members.items()
    }
    envs = made(task=type("Mine", (Still,), given)) if members else made()
    envs.reset(seed=0)
    envs.step(envs.action_space.sample() if actions is None else actions)


def restored(**keywords: Any) -> None:
    envs = made()
    envs.reset(seed=0)
    made(**keywords).restore(envs.snapshot())


def used_by_two_threads() -> None:
    def step(_task: Still, batch: flockstep.Batch) -> Any:
        return ThreadPoolExecutor(1).submit(batch.sense).result()

    envs = made(task=type("Mine", (Still,), {"step": step}))
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


CUBE = list(itertools.product((-0.1, 0.1), repeat=3))
#: Names that the calls use.
NAMES = {**vars(flockstep), "gymnasium": gymnasium, "np": np, "spaces": spaces, "connect": flockstep.connect}
NAMES |= {"sb3": flockstep.sb3, "HOME": HOME, "ROOM": ROOM, "Still": Still}
NAMES |= {"made": made, "stepped": stepped, "restored": restored}
NAMES |= {"used_by_two_threads": used_by_two_threads, "CUBE": CUBE}

MESSAGES = """
made(max_episode_step=3)
  TypeError: DroneVectorEnv.__init__() got an unexpected keyword argument 'max_episode_step'. Did you mean
  'max_episode_steps'?
made(quite_something_else=3)
  TypeError: DroneVectorEnv.__init__() got an unexpected keyword argument 'quite_something_else'
made(seed=3)
  TypeError: DroneVectorEnv.__init__() got an unexpected keyword argument 'seed': pass it to reset(seed=...)
LidarConfig(beam=3)
  TypeError: LidarConfig.__init__() got an unexpected keyword argument 'beam'. Did you mean 'beams'?
Batch([], num_drone=3)
  TypeError: Batch.__init__() got an unexpected keyword argument 'num_drone'. Did you mean 'num_drones'?
color_blob(images=np.zeros((4, 4, 3), np.uint8), color=ColorRange())
  TypeError: color_blob() got an unexpected keyword argument 'images'. Did you mean 'image'?
PPO("MlpPolicy", None, lr=1e-3)
  TypeError: PPO.__init__() got an unexpected keyword argument 'lr'. Did you mean 'learning_rate'?
made(hold_m=3)
  TypeError: hold_m: a keyword of the hover task, but another task is given
made(task=HoverConfig(), step_m=3)
  TypeError: step_m: a keyword of the navigation, dodge, swap and formation tasks, but another task is given
made(task=HoverConfig(), hold_x=3)
  TypeError: DroneVectorEnv.__init__() got an unexpected keyword argument 'hold_x'. Did you mean 'hold_s'?
made(rate_hz=3)
  TypeError: rate_hz: a field of a configuration: give it as pose_sensor=flockstep.PoseSensorConfig(rate_hz=...)
made(policy_hz=30, clock=ClockConfig(policy_hz=20))
  TypeError: policy_hz: expected one value, got policy_hz=30.0 and clock.policy_hz=20.0
Batch([], camera=[], cameras=[])
  TypeError: camera: expected None with cameras, another name of it
gymnasium.make("flockstep/LidarNavigation-v0", num_envs=4)
  TypeError: num_envs: gymnasium.make makes one env; for several, use gymnasium.make_vec was raised from the
  environment creator for flockstep/LidarNavigation-v0 with kwargs ({'observation': 'goal', 'num_envs': 4})
sb3.make_vec("flockstep/Hover-v0", 2, autoreset_mode="disabled")
  TypeError: make_vec: autoreset_mode cannot be chosen: it needs same-step autoreset
made(num_envs="4")
  ValueError: num_envs: expected an integer >= 1, got '4'; for an env by its id, call gymnasium.make_vec('4',
  num_envs=...)
Batch([HOME], "4")
  TypeError: num_drones: expected an integer, got '4'
made(worlds=3)
  TypeError: worlds: expected a name, a path, a World or a sequence of these, got 3
Batch([3])
  TypeError: worlds: expected a name, a path or a World, got int
made(camera=3)
  TypeError: camera: expected a flockstep.CameraConfig, None or a sequence of flockstep.CameraConfig objects, got 3
Batch([HOME], lidar={"beams": 10})
  TypeError: lidar: expected a flockstep.LidarConfig, None or a sequence of flockstep.LidarConfig objects, got
  {'beams': 10}: write flockstep.LidarConfig(beams=10)
made(lidar={})
  TypeError: lidar: expected a flockstep.LidarConfig, None or a sequence of flockstep.LidarConfig objects, got {}: write
  flockstep.LidarConfig()
DynamicsConfig(wind={"gusts": 3})
  TypeError: wind: expected a flockstep.WindConfig, got {'gusts': 3}: write flockstep.WindConfig(gusts=3)
made(lights="noon")
  TypeError: lights: expected a flockstep.Light, None or a sequence of flockstep.Light objects, got 'noon'
made(drone=4)
  TypeError: drone: expected a flockstep.DroneModel, the name or path of one, or None, got 4
made(task="flockstep/Swap-v0")
  TypeError: task: expected a flockstep.Task, a NativeTask or one of NavigationConfig, HoverConfig, TrackConfig,
  RaceConfig, DodgeConfig, SwapConfig, FormationConfig, got 'flockstep/Swap-v0'. gymnasium.make_vec makes an env of an
  id
register_task("mine/Task-v0", dict)
  TypeError: task: expected a subclass of flockstep.Task or the path of a library, got <class 'dict'>
NativeTask(3)
  TypeError: path: expected the path of a shared library (a str or a Path), got 3
made(autoreset_mode="next_stop")
  ValueError: autoreset_mode: expected 'next_step', 'same_step', 'disabled' or an AutoresetMode, got 'next_stop'. Did
  you mean 'next_step'?
made(render_mode="window")
  ValueError: render_mode: expected None or 'human', 'rgb_array', got 'window'
made(worlds=None, task=Still)
  ValueError: Still declares no worlds: set Still.worlds = 'train', or pass worlds=
made(worlds=ROOM)
  ValueError: world "unnamed": markers.start: expected a point, found none (world.with_drawn_markers(seed) draws them)
made(worlds=ROOM, task=Still).reset()
  ValueError: world 'unnamed' has no start marker, where Task.reset puts drones: draw markers by
  world.with_drawn_markers(seed), or override reset
World.load("a.fbx")
  ValueError: 'a.fbx': .fbx files are not supported: export glTF (.glb)
World.load("trian")
  ValueError: unknown scene 'trian'. Did you mean 'train', 'playground/train-1' or 'playground/train-2'?
  flockstep.scenes.names() lists all
World.from_dict({})
  ValueError: scene: expected a field "flockstep_scene", found none: add "flockstep_scene": 1
LidarConfig(beams=0)
  ValueError: lidar.beams: expected an integer in [1, 262144], got 0
LidarConfig(max_range_m=-1)
  ValueError: lidar.max_range_m: expected a finite number > 0, got -1
LidarConfig(hfov_deg="wide")
  TypeError: hfov_deg: expected a number, got 'wide'
CameraConfig(outputs="rgb")
  TypeError: outputs: expected a sequence of names, got 'rgb': write ('rgb',)
CameraConfig(outputs=["dept"])
  ValueError: outputs: expected names among rgb, depth, semantic, instance, normal, grey, hsv, events, got "dept".
  Did you mean depth?
CameraConfig(near_m=2, far_m=1)
  ValueError: camera.far_m: expected a number > near_m (2.000000), got 1
DroneVectorEnv.from_recipe('{"worlds": ["/etc/passwd"]}')
  ValueError: worlds: this recipe may only use bundled scenes and drones, not "/etc/passwd"; pass allow_files=True
  (--allow-files) to allow files
Recipe.from_json('{"clock": {"policy_hx": 5}}')
  ValueError: clock.policy_hx: expected one of policy_hz, physics_hz, controller_hz, got policy_hx. Did you mean
  policy_hz?
restored(policy_hz=20)
  ValueError: snapshot: expected one of a batch with the same configuration and worlds, got one that differs in
  clock.policy_hz
Batch([HOME]).restore(b"12345")
  ValueError: snapshot: 5 bytes are too few for a snapshot
PPO.load("no/model")
  FileNotFoundError: no such model file: no/model.zip
NativeTask("./fly.so")
  MissingFileError: no such shared library: './fly.so'
DroneModel.load("nix.json")
  MissingFileError: nix.json: cannot read a drone file: No such file or directory
DroneModel.load("racer")
  ValueError: drone: expected one of crazyflie, f450, f550, hummingbird, kingfisher, naki, racer5, t650, x500,
  random/seed-N, or the path of a file ending in .json, got "racer". Did you mean racer5?
connect("unix:/nowhere")
  ConnectionError: no server at unix:/nowhere: start one with `python -m flockstep serve RECIPE` (No such file or
  directory)
connect("a:b:c")
  ValueError: address: expected 'HOST:PORT', 'ws://HOST:PORT', 'wss://HOST:PORT' or 'unix:PATH', got 'a:b:c' (Port
  could not be cast to integer value as 'b:c')
serve(Batch([HOME]), tokn="x")
  TypeError: ServerConfig.__init__() got an unexpected keyword argument 'tokn'. Did you mean 'token'?
serve(Batch([HOME]), address="0.0.0.0")
  ValueError: token: expected a secret, because other machines reach the address 0.0.0.0, got none (set
  FLOCKSTEP_TOKEN)
made().reset(seed=-1)
  ValueError: seed: expected a number from 0 to 2**64 - num_envs, got -1
made().reset(options={"mask": 1})
  ValueError: options: expected only 'reset_mask', got 'mask'
made().step([0, 0])
  ResetNeeded: call reset before step
stepped([0, 6])
  ValueError: actions (row 1): expected an integer in [0, 6), got 6
stepped(step=None)
  ValueError: Mine.step: expected a pair (reward, terminated), got None
stepped(step={"cost": np.zeros(2)})
  ValueError: Mine.step: expected a pair (reward, terminated), got dict
stepped(step=(np.zeros(3), np.zeros(2, bool)))
  ValueError: Mine.step: expected a reward of shape (2,), got (3,)
stepped(step=(np.zeros(2), np.zeros(2)))
  ValueError: Mine.step: expected terminated to be bool, got float64
stepped(act=None)
  ValueError: Mine.act: expected positions (N, 3), or a pair of positions and quaternions (N, 4), got None
stepped(observe=np.zeros((2, 4), np.float32))
  ValueError: Mine.observe: expected shape (2, 3), got (2, 4)
stepped(observation_space=spaces.Box(0, 9, (3,)), observe=np.full((2, 3), 10, np.float32))
  RuntimeWarning: Mine.observe: expected numbers in [0.0, 9.0], as the space says, got 10.0 in env 0 at index [0]
stepped(step=(np.array([0, np.nan]), np.zeros(2, bool)))
  RuntimeWarning: Mine.step: reward term 'reward' is nan in env 1; its episode ends here as a bad state
stepped(markers="goal")
  TypeError: Mine.markers: expected a tuple of names, got 'goal': write ('goal',)
stepped(reward_term=("cost",))
  TypeError: Mine.reward_term resembles a name of Task. Did you mean 'reward_terms'? If not, begin it with an
  underscore; an attribute may be set in setup instead
stepped(max_episode_steps=2.0)
  ValueError: max_episode_steps: expected an integer in [0, 2147483647], got 2.0
stepped(info_names=("success",))
  ValueError: Mine.info_names: expected names that are not taken (episode_return, episode_length, success, crashed,
  bad_state, episode_end, episode_terms, episode, is_success, terminal_observation), got 'success'
evaluate(None, Still, episodes=0, worlds=HOME)
  ValueError: episodes: expected an integer >= 1, got 0
record("flight.avi")
  ValueError: path: expected a name that ends with one of .html, .mcap, .mp4, .gif, got 'flight.avi'
record("flight.gif", policy="policy.zip")
  TypeError: policy: expected a model with predict, a function or None, got 'policy.zip': load it first, as by
  PPO.load(path); that runs code from the file: load only policies you trust
stepped([0])
  ValueError: actions: expected shape (2,), got shape (1,)
stepped(np.zeros((2, 3), np.float32))
  ValueError: actions: expected an array of integers, got dtype float32
[envs := made(action="displacement"), envs.reset(seed=0), envs.step(np.full((2, 3), np.nan))]
  ValueError: actions (row 0): expected finite numbers, got nan
made().batch.position.fill(0)
  ValueError: assignment destination is read-only
made(control="velocity")
  ValueError: control: expected "pose" (motion is "kinematic": give motion="rotors"), got velocity
made(motion="rotors", drone=DroneModel(CUBE))
  ValueError: drone: expected one with an airframe, to fly by its rotors (such as a bundled one: DroneModel.names()),
  got only a hull
DroneModel.from_dict({"flockstep_drone": 1, "like": "x500", "mass_kg": 2064})
  ValueError: drone: rotors: expected a thrust-to-weight above 1, to hover, got 0.00168879
made(policy_hz=30, physics_hz=100)
  ValueError: physics_hz: expected a multiple of policy_hz (30 Hz), at most 1000 times it, got 100 Hz
made(lidar=LidarConfig(rate_hz=3))
  ValueError: lidar.rate_hz: expected a rate that divides the clock's 10.000000 ticks per second, got 3
Batch([HOME], lidar=LidarConfig()).lidar().ranges
  RuntimeError: the LiDAR has not scanned yet: call sense(), or reset() a task, before its ranges are read
Batch([HOME], camera=CameraConfig(capture_mode="on_demand")).camera().save_frames("frames")
  ValueError: camera "front": no drone has a frame; call sense or capture first
Batch([HOME], 2).set_pose(quat_wxyz=np.ones((2, 4)))
  ValueError: quat_wxyz (row 0): expected a unit quaternion (w, x, y, z), got one of norm 2.000000
Batch([HOME], dynamics=DynamicsConfig(motion="rotors", control="attitude")).fly(np.array([[5, 45, 0, 0]]))
  ValueError: command (row 0): expected a roll within +-pi rad (not degrees), got 45
made(worlds=ROOM.with_markers(start=(0, 0, 0), goal=(5, 5, 5)))
  ValueError: world "unnamed": markers.start: expected room for the drone, got (0, 0, 0), where it touches an obstacle
used_by_two_threads()
  RuntimeError: this Batch is in use by another thread: one call at a time
"""
ROWS = re.findall(r"^(\S.*)\n((?:  .*\n)+)", MESSAGES, re.MULTILINE)


@pytest.mark.parametrize(("call", "said"), ROWS, ids=[call for call, _ in ROWS])
def test_a_message_has_these_words(call: str, said: str) -> None:
    said = " ".join(said.split())
    with pytest.raises(Exception) as raised:  # noqa: PT011 # any, whose name is in the text
        eval(call, NAMES)
    assert f"{raised.typename}: {raised.value}" == said
    if ": expected " not in said and "gymnasium.make" not in call:  # Gymnasium adds all keywords
        assert len(said) <= 200, "a sentence"


def test_every_message_is_read() -> None:
    assert len(ROWS) == len(re.findall(r"^\S", MESSAGES, re.MULTILINE)) > 60


def test_the_page_of_errors_has_messages_that_are_raised() -> None:
    text = (ROOT / "docs" / "reference" / "errors.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(.+?)` \|", text.partition("| message |")[2], re.MULTILINE)
    assert len(listed) > 5
    for shown in listed:
        pattern = re.escape(shown).replace("…", ".*")
        assert any(re.search(pattern, " ".join(said.split())) for _, said in ROWS), shown


SAID = "lidar.channels: expected an integer in [1, 4], got 10"


@pytest.mark.parametrize(
    ("said", "asked", "is_found"),
    [
        (SAID, ("lidar.channels", 10), True),
        (SAID, ("lidar", 10), False),  # a field of it
        (SAID, ("channels", 10), False),
        (SAID, ("integer",), False),  # not the field
        (SAID, ("lidar.channels", 0), False),  # a part of the number
        (SAID, ("lidar.channels", "4"), True),
        ("x: got -0.5", ("x", 0.5), False),
        ("x: got -0.5", ("x", -0.5), True),
        ("x: got 'up'", ("x", "up"), True),
        ("x['a']: got nan", ("x['a']", float("nan")), True),
        ("the server at a:1 is gone: start one", ("is gone", "one"), True),
        ("the servers are gone", ("server",), False),
    ],
)
def test_the_helper_of_other_tests_tells_messages_apart(said: str, asked: tuple[Any, ...], is_found: bool) -> None:
    assert bool(re.search(message(*asked), said)) == is_found
