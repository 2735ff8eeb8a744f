"""A function in place of the built-in controller commands the rotors, tick by tick."""

import gc
import weakref

import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused
from simple_tasks import Commanded, Still

import flockstep
from flockstep import vary
from flockstep.variations import uniform

HALL = world_of(room={"min": [-20, -20, 0], "max": [20, 20, 20]}, markers={"start": [0, 0, 5]})
WALL = flockstep.BodyConfig(
    size_m=[0.5, 6, 6], position_m=[1.5, 0, 5], motion=flockstep.BodyMotion(velocity_mps=[-3, 0, 0])
)


def envs_of(control="body_rates", num_envs=4, *, dynamics=None, **keywords):
    dynamics = flockstep.DynamicsConfig(motion="rotors", control=control, **(dynamics or {}))
    clock = flockstep.ClockConfig(policy_hz=50, physics_hz=500)
    given = {"task": Commanded, "worlds": HALL, "drone": "racer5", "dynamics": dynamics, "clock": clock}
    return begun(num_envs, **{"num_threads": 2, **given, **keywords})


class Bouncing(Commanded):
    """Its episodes go on after a contact."""

    def step(self, batch):
        return np.zeros(batch.num_drones), np.zeros(batch.num_drones, bool)


def same(command, tick):
    return command


def flown(control, **keywords):
    """All that drones do and read by speeds of their rotors near hover, 30 steps of ten ticks."""
    envs = envs_of(control, **keywords)
    batch, rng, seen = envs.batch, np.random.default_rng(0), []
    hover = float(batch.rotor_speed[0, 0])
    if control != "rotor_speeds":
        batch.set_controller(same)
    for _ in range(30):
        envs.step((hover * rng.uniform(0.97, 1.03, (envs.num_envs, 4))).astype(np.float32))
        own = (batch.flown, batch.path, batch.acceleration, batch.wind, batch.tick, batch.contact.hit, batch.steps)
        read = [batch.sensor(each.name)["accelerometer"] for each in batch.imus]
        drawn = [batch.params, batch.battery] if batch.variations else []
        seen.append(np.concatenate([np.ravel(each).astype(float) for each in (*own, *read, *drawn)]))
    return np.stack(seen)


@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"wind": flockstep.WindConfig(gusts="ornstein_uhlenbeck")},
        {"variations": vary(battery_life_s=1.0, battery_fall=0.3)},
        {"variations": vary(dead_rotor=2, dead_from_s=0.2)},
        {"variations": vary(push_mps2=uniform(-2, 2, when="interval", interval_s=0.1))},
        {"bodies": WALL, "autoreset_mode": "same_step"},
        {"bodies": WALL, "dynamics": {"on_contact": "bounce"}, "task": Bouncing},
        {"drones_per_env": 2, "interaction": "both", "dynamics": {"downwash": True}},
        {"frame_skip": 3, "max_episode_steps": 20},
    ],
    ids=["plain", "gusts", "battery", "rotor", "interval", "body", "bounce", "two", "frame_skip"],
)
def test_speeds_fly_as_those_of_the_control_rotor_speeds(keywords):
    by_ticks = {"imu": flockstep.ImuConfig(rate_hz=500), **keywords}  # else both round legs of other lengths
    expected = flown("rotor_speeds", **by_ticks)
    np.testing.assert_array_equal(flown("body_rates", **by_ticks), expected)
    rounded = flown("rotor_speeds", **keywords)
    np.testing.assert_allclose(flown("body_rates", **keywords), rounded, rtol=1e-4, atol=1e-3)
    if keywords:
        plain = flown("rotor_speeds")
        assert plain.shape != rounded.shape or np.abs(plain - rounded).max() > 0.01


def test_it_is_called_before_each_tick_with_the_commands_and_sees_the_state():
    envs, calls = envs_of(num_envs=2, frame_skip=2), []
    batch = envs.batch
    speeds = np.full((2, 4), float(batch.rotor_speed[0, 0]) * 1.2)

    def climb(command, tick):
        calls.append((tick, batch.tick[0], command.copy(), batch.position[0, 2]))
        return speeds

    batch.set_controller(climb)
    actions = np.float32([[9.81, 0.1, 0.2, 0.3], [9.0, 0, 0, -0.1]])
    envs.step(actions)
    ticks, counted, commands, heights = zip(*calls, strict=True)
    assert ticks == (*range(10), *range(10))
    assert counted == tuple(range(20))
    np.testing.assert_array_equal(commands, np.tile(actions, (20, 1, 1)))
    assert (np.diff(heights) >= 0).all()
    assert batch.position[0, 2] > heights[-1] > heights[5] > 5
    batch.set_controller(None)
    envs.step(actions)
    assert len(calls) == 20


def test_bad_commands_end_their_own_episode():
    class Bad(Commanded):
        def act(self, batch, actions):
            return np.where(actions == 7, np.nan, actions)

    envs = envs_of(num_envs=2, task=Bad)
    hover = np.full((2, 4), float(envs.batch.rotor_speed[0, 0]))
    envs.batch.set_controller(lambda command, tick: hover)
    *_, terminated, _, _ = envs.step(np.float32([[7, 0, 0, 0], [9.81, 0, 0, 0]]))
    assert terminated.tolist() == [True, False]


def test_what_raises_ends_the_step_and_a_reset_goes_on():
    envs, actions = envs_of(num_envs=2), np.zeros((2, 4), np.float32)
    batch = envs.batch

    def stop(command, tick):
        if tick == 3:
            raise KeyboardInterrupt
        return np.zeros((2, 4))

    batch.set_controller(stop)
    with pytest.raises(KeyboardInterrupt):
        envs.step(actions)
    with refused(RuntimeError, "reset"):
        envs.step(actions)
    for call in (lambda: batch.step(actions), lambda: batch.set_controller(None), lambda: batch.fly(actions)):
        envs.reset(seed=0)
        batch.set_controller(lambda command, tick, call=call: call())
        with refused(RuntimeError, "steps"):
            envs.step(actions)
    for speeds in (None, [0] * 4, np.zeros((2, 3)), actions + np.nan, actions + 1e7, "fast", 1j * actions):
        envs.reset(seed=0)
        batch.set_controller(lambda command, tick, speeds=speeds: speeds)
        with pytest.raises(ValueError, match=r"^(controller|command)"):
            envs.step(actions)
    batch.set_controller(None)
    envs.reset(seed=0)
    envs.step(actions)
    fresh = envs_of(num_envs=2)
    fresh.step(actions)
    np.testing.assert_array_equal(batch.flown, fresh.batch.flown)


def test_batches_that_it_cannot_fly_are_refused():
    for what in (3, "rotors", ()):
        with refused(TypeError, "controller"):
            envs_of().batch.set_controller(what)
    with refused(ValueError, "controller", "action_delay_s"):
        envs_of(variations=vary(action_delay_s=0.01)).batch.set_controller(same)
    with refused(ValueError, "controller", "pose"):
        envs_of("pose", task=Still).batch.set_controller(same)
    with refused(RuntimeError, "set_controller", "kinematic"):
        begun(task=Still, worlds=HALL).batch.set_controller(same)
    with refused(RuntimeError, "task"):
        flockstep.Batch(HALL, dynamics=flockstep.DynamicsConfig(motion="rotors")).set_controller(same)


def test_learners_fly_by_it_and_gradients_refuse_it():
    envs, calls = begun(4, task=flockstep.HoverConfig(), autoreset_mode="same_step"), []
    hover = np.full((4, 4), float(envs.batch.rotor_speed[0, 0]))

    def stay(command, tick):
        calls.append(tick)
        return hover

    envs.batch.set_controller(stay)
    flockstep.PPO("MlpPolicy", envs, n_steps=8, batch_size=32, n_epochs=1, seed=0).learn(32)
    assert calls == list(range(max(calls) + 1)) * 8
    with refused(ValueError, "controller"):
        flockstep.APG("MlpPolicy", envs, seed=0).learn(1)


def test_a_closed_env_frees_it():
    class Own:
        def __call__(self, command, tick):
            return command

    envs, own = envs_of(), Own()
    freed = weakref.ref(own)
    envs.batch.set_controller(own)
    del own
    assert freed() is not None
    envs.close()
    gc.collect()
    assert freed() is None
