"""Parameters of the drones at the end of observations, against the parameters of the batch."""

import numpy as np
import pytest
from gymnasium import spaces
from messages import refused
from simple_tasks import Climb

import flockstep
from flockstep import PPO, DroneParameters, ObservationConfig, parameter_names, vary
from flockstep.variations import uniform

LAWS = vary(
    mass_scale=(0.7, 1.3),
    stretch=(0.8, 1.2),
    lag_up_scale=(0.8, 1.2),
    push_mps2=uniform(-0.5, 0.5, when="interval", interval_s=0.05),
)
#: Names, and the columns that they stand for in their order.
NAMES = ["push_mps2", "mass_scale", "stretch[1]", "thrust_scale"]
SHOWN = ["push_mps2[0]", "push_mps2[1]", "push_mps2[2]", "mass_scale", "stretch[1]", "thrust_scale"]


class Rise(Climb):
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    action_space = spaces.Box(-1, 1, (4,), np.float32)
    worlds = "train"

    def act(self, batch, actions):
        return actions


def privileged(params, shown=SHOWN):
    """The numbers (..., k) of parameters (..., P)."""
    defaults = np.concatenate(
        [np.atleast_1d(np.float32(getattr(DroneParameters(), name))) for name in DroneParameters.__match_args__]
    )
    columns = [parameter_names.index(name) for name in shown]
    return (params[..., columns].astype(float) - defaults[columns]).astype(np.float32)


def hover(num_envs=6, **keywords):
    given = {"task": flockstep.HoverConfig(), "variations": LAWS, "max_episode_steps": 7, "num_threads": 1}
    return flockstep.DroneVectorEnv(num_envs, **(given | keywords))


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"frame_skip": 3},
        {"drones_per_env": 2, "episodes": "each"},
        {"task": Rise},
    ],
    ids=["hover", "skip", "drones", "python"],
)
def test_they_are_the_parameters_of_the_drone(mode, keywords):
    env, plain = (hover(autoreset_mode=mode, **keywords, **more) for more in ({"privileged": NAMES}, {}))
    observation, other = (each.reset(seed=3)[0] for each in (env, plain))
    k, size = len(SHOWN), plain.single_observation_space.shape[0]
    assert env.single_observation_space.shape == (size + k,)
    random = np.random.default_rng(0)
    seen, ended = [], 0
    for _ in range(40):
        np.testing.assert_array_equal(observation[:, :size], other)
        np.testing.assert_array_equal(observation[:, size:], privileged(env.batch.params))
        assert env.observation_space.contains(observation)
        before = env.batch.params.copy()
        seen.append(observation[:, size:].copy())
        action = random.uniform(-0.1, 0.1, env.action_space.shape).astype(np.float32)
        (observation, *rest), (other, *_) = (each.step(action) for each in (env, plain))
        infos = rest[-1]
        for row in np.flatnonzero(infos.get("_final_obs", [])):
            ended += 1
            final = infos["final_obs"][row]
            # Masses are those of the episode that ended, and pushes may have changed in its last step.
            np.testing.assert_array_equal(final[size + 3 :], privileged(before[row], SHOWN[3:]))
            assert (final[size + 3] != observation[row, size + 3]).all()
    assert mode == "next_step" or ended > 10
    assert (np.std(seen, axis=0)[:, [0, 3, 4]] > 0.01).all()
    assert (np.array(seen)[:, :, 5] == 0).all()  # a parameter that does not differ


def test_they_are_neither_late_nor_remembered():
    observed = ObservationConfig(history=3, past_actions=2, delay_s=0.1, age=True)
    env, plain = (hover(observed=observed, **more) for more in ({"privileged": NAMES}, {}))
    observation, other = (each.reset(seed=3)[0] for each in (env, plain))
    for step in range(20):
        np.testing.assert_array_equal(observation[:, : -len(SHOWN)], other)
        np.testing.assert_array_equal(observation[:, -len(SHOWN) :], privileged(env.batch.params))
        action = np.full(env.action_space.shape, 0.01 * step, np.float32)
        observation, other = (each.step(action)[0] for each in (env, plain))


class Still(flockstep.Task):
    """Observes heights, in a row for each env, and rewards nothing."""

    worlds = "train"
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="velocity")
    observation_space = spaces.Box(-np.inf, np.inf, (2,), np.float64)
    action_space = spaces.Box(-1, 1, (4,), np.float32)
    row_kind = "env"

    def act(self, batch, actions):
        return np.repeat(actions, batch.drones_per_env, axis=0)

    def step(self, batch):
        return np.zeros(batch.num_envs), np.zeros(batch.num_envs, bool)

    def observe(self, batch):
        return batch.position[:, 2].reshape(-1, 2)


class StillByName(Still):
    observation_space = spaces.Dict({"heights": Still.observation_space, "zeros": Still.observation_space})

    def observe(self, batch):
        heights = super().observe(batch)
        return {"heights": heights, "zeros": 0 * heights}


def test_a_row_for_an_env_has_those_of_all_its_drones():
    env = hover(3, task=Still, drones_per_env=2, privileged=["mass_scale", "lag_up_scale"])
    observation = env.reset(seed=0)[0]
    assert observation.shape == (3, 6)
    expected = privileged(env.batch.params, ["mass_scale", "lag_up_scale"]).reshape(3, 4)
    np.testing.assert_array_equal(observation[:, 2:].astype(np.float32), expected)
    assert np.unique(expected).size == 12


def test_they_follow_set_params():
    env = hover(privileged="mass_scale", max_episode_steps=100)
    env.reset(seed=0)
    params = env.batch.params.copy()
    params[:, parameter_names.index("mass_scale")] = 1.25
    env.batch.set_params(params)
    assert (env.step(np.zeros(env.action_space.shape, np.float32))[0][:, -1] == 0.25).all()
    with refused(ValueError, "snapshot"):
        hover(privileged="stretch[0]", max_episode_steps=100).restore(env.snapshot())


def test_the_learner_keeps_them_from_the_policy():
    env = hover(70, privileged=NAMES, autoreset_mode="same_step")
    model = PPO("MlpPolicy", env, critic_only=len(SHOWN), n_steps=8, batch_size=140, n_epochs=2, seed=0)
    model.learn(2 * 8 * 70)
    observation = env.reset(seed=1)[0]
    np.testing.assert_array_equal(model.learner.read_observation(env.batch), observation)
    actions = model.predict(observation, deterministic=True)[0]
    plain = hover(70, autoreset_mode="same_step").reset(seed=1)[0]
    np.testing.assert_array_equal(model.predict(plain, deterministic=True)[0], actions)
    assert (model.learner.values(observation) != model.learner.values(observation * ([1] * 16 + [0] * 6))).any()


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"privileged": [3]}, (3,)),
        ({"privileged": ["mas_scale"]}, ("mas_scale", "mass_scale")),
        ({"privileged": ["stretch", "stretch[2]"]}, ("stretch[2]",)),
        ({"privileged": ["mass_scale"], "variations": []}, ("mass_scale",)),
    ],
    ids=["no text", "unknown", "twice", "nothing differs"],
)
def test_bad_names_are_refused(keywords, said):
    with refused((TypeError, ValueError), "privileged", *said):
        hover(**keywords)


def test_they_need_a_vector_of_floats():
    with refused(ValueError, "privileged", 1):
        hover(task=StillByName, drones_per_env=2, privileged=["mass_scale"])
    with refused(ValueError, "privileged", 1):
        flockstep.Batch("playground/train-1", 2, dynamics=Still.dynamics, variations=LAWS, privileged=["mass_scale"])
