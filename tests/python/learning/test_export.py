"""flockstep.export: the C header, compiled, and the ONNX file, in onnxruntime, against the models' own actions."""

import re
import subprocess

import gymnasium
import numpy as np
import onnx
import onnxruntime
import pytest
import sb3_contrib
import stable_baselines3
import torch
from c_policy import STRICT, CPolicy
from gymnasium import spaces
from messages import refused
from ppo_models import NET, SMALL, Aim, Still, box, hover
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import flockstep
import flockstep.sb3
from flockstep import PPO

pytestmark = pytest.mark.filterwarnings("ignore:batch_size. expected at most:UserWarning")
ROUNDING = 1e-6
DICT = spaces.Dict({"b": box(2, 2), "a": box(1)})


def exported(model, folder, observations, actions, **keywords):
    """Return functions that act by the header and by the ONNX file of a model."""
    for ending in (".h", ".onnx"):
        flockstep.export(model, folder / f"policy{ending}", **keywords)
    session = onnxruntime.InferenceSession(folder / "policy.onnx")
    return CPolicy(folder / "policy.h", observations, actions), lambda rows: session.run(None, {"observation": rows})[0]


def check(model, folder, rows, observe=None, scale=1.0, **keywords):
    """Compare with what the model predicts; observe: makes its observations of rows."""
    expected = model.predict(rows if observe is None else observe(rows), deterministic=True)[0].reshape(len(rows), -1)
    assert (expected != expected[0]).any(), "the model does not depend on its observations"
    by_c, by_onnx = exported(model, folder, rows.shape[1], expected.shape[1], **keywords)
    for act in (by_c, by_onnx):
        found = act(rows).reshape(expected.shape)
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * scale)
    assert by_c.self_test() <= ROUNDING * scale


def drawn(space, rows=5000):
    """Observations within a space, of a size as in flights; ranges and areas are not negative."""
    low, high = space.low.ravel(), space.high.ravel()
    values = np.random.default_rng(0).uniform(np.maximum(low, -2), np.minimum(high, 2), (rows, len(low)))
    if np.isfinite(low).all():
        values[:, 1:] = np.abs(values[:, 1:])
    return values.astype(np.float32)


@pytest.mark.parametrize("name", flockstep.policies.names())
def test_bundled_policies(name, tmp_path):
    model = flockstep.policies.load(name)
    check(model, tmp_path, drawn(model.observation_space))


def test_the_example_flies_a_header_at_500_hz(example):
    found, difference = example("fly_header").catch(50)
    assert found.success_rate > 0.9
    assert difference <= 1e-6


def test_normalized_observations_far_from_zero(tmp_path):
    """The mean is a thousand times the deviation, so float32 of the mean alone would be off by 3e-5 deviations."""
    model = PPO("MlpPolicy", Aim(4), policy_kwargs=NET, normalize_observations=True, **SMALL)
    mean, variance = np.array([54321.0123]), np.array([3.0])
    model.learner.set_moments((mean, variance, 1.0), model.learner.return_moments)
    rows = (mean + np.linspace(-30, 30, 1001)[:, None]).astype(np.float32)  # the last ones are clipped
    check(model, tmp_path, rows)


def test_what_only_the_critic_gets_is_left_out(tmp_path):
    model = PPO("MlpPolicy", Still(box(4)), critic_only=1, **SMALL)
    check(model, tmp_path, drawn(box(3)))


@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_choices_and_parts(activation, tmp_path):
    arguments = {"policy_kwargs": {"net_arch": [8, 5, 3], "activation_fn": activation}, **SMALL}
    check(PPO("MlpPolicy", Aim(4, is_discrete=True), **arguments).learn(512), tmp_path, drawn(box(1)))
    parts = PPO("MultiInputPolicy", Still(DICT, spaces.Box(-1, 0.25, (2, 3), np.float32)), **arguments)
    names = [(name, part.shape) for name, part in parts.observation_space.spaces.items()]

    def observe(rows):
        first, values = 0, {}
        for name, shape in names:
            size = int(np.prod(shape))
            values[name] = rows[:, first : first + size].reshape(len(rows), *shape)
            first += size
        return values

    check(parts, tmp_path, 3 * drawn(box(5)), observe)


def weighty(model):
    """Return a model of Stable-Baselines3 with random weights, so that its actions differ."""
    random = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for values in model.policy.parameters():
            if values.ndim == 2:
                values.normal_(0.0, 1.5 / values.shape[1] ** 0.5, generator=random)
    return model


@pytest.mark.parametrize("kind", ["PPO", "A2C", "SAC", "TD3", "DQN"])
def test_models_of_stable_baselines3(kind, tmp_path):
    choice = spaces.Discrete(3) if kind == "DQN" else spaces.Box(np.float32([-2, -1]), np.float32([1, 5]))
    arguments = {"net_arch": [8, 6]}
    if kind == "PPO":
        arguments["activation_fn"] = torch.nn.ELU
    model = weighty(getattr(stable_baselines3, kind)("MlpPolicy", Still(box(3), choice), policy_kwargs=arguments))
    check(model, tmp_path, drawn(box(3)), scale=6.0)  # the width of the actions


@pytest.mark.parametrize("features", ["GoalFeatures", "BlobFeatures", "PointFeatures"])
def test_features_and_normalization_of_stable_baselines3(features, tmp_path):
    model = PPO(
        "MlpPolicy",
        Still(spaces.Box(0, 1, (7,), np.float32)),
        policy_kwargs={**NET, "features_extractor_class": features},
    )
    check(weighty(model.to_sb3()), tmp_path, drawn(model.observation_space))
    model = PPO("MlpPolicy", Aim(4), normalize_observations=True, **SMALL).learn(64)
    check(weighty(model.to_sb3()), tmp_path, drawn(box(1)))


@pytest.mark.parametrize("cls", [PPO, stable_baselines3.PPO])
def test_vec_normalize_becomes_part_of_the_policy(cls, tmp_path):
    envs = VecNormalize(DummyVecEnv([lambda: Still(box(3))] * 4), clip_obs=0.7)
    model = cls("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1)
    envs.obs_rms.mean, envs.obs_rms.var = np.array([1.0, 2.0, 300.0]), np.array([4.0, 0.25, 1.0])
    rows = (envs.obs_rms.mean + drawn(box(3))).astype(np.float32)
    check(model, tmp_path, rows, envs.normalize_obs)
    model.save(tmp_path / "model")
    check(cls.load(tmp_path / "model"), tmp_path, rows, envs.normalize_obs, env=envs)


def test_the_header_is_also_cpp_and_knows_its_actions(tmp_path):
    flockstep.export(flockstep.policies.load("race"), tmp_path / "race.h")
    text = (tmp_path / "race.h").read_text()
    assert text.isascii()
    (tmp_path / "main.cpp").write_text('#include "race.h"\nint main() { return !(race_self_test() <= 1e-6f); }\n')

    def run():
        build = ["c++", "-std=c++11", *STRICT, "main.cpp", "-o", "main"]
        subprocess.run(build, cwd=tmp_path, check=True)
        return subprocess.run(["./main"], cwd=tmp_path, check=False).returncode

    assert run() == 0
    weights = text.index("{", text.index("race_weight_1")) + 1
    for number in ("9.0f,", "NAN,"):
        (tmp_path / "race.h").write_text(text[:weights] + number + text[text.index(",", weights) + 1 :])
        assert run() == 1


def test_nan_gives_nan(tmp_path):
    model = PPO("MlpPolicy", Still(box(3)), policy_kwargs={**NET, "activation_fn": "relu"}, **SMALL)
    by_c, by_onnx = exported(model, tmp_path, 3, 2)
    rows = np.float32([[0, np.nan, 0]])
    assert np.isnan(by_c(rows)).all()
    assert np.isnan(by_onnx(rows)).all()
    model = PPO("MlpPolicy", Still(box(3), spaces.Discrete(4, start=2)), **SMALL)
    by_c, _ = exported(model, tmp_path, 3, 1)
    assert by_c(rows) == 2


# --- words


def listed(text):
    """Return the numbers of an observation that the comment names, in its order."""
    found = []
    for first, last in re.findall(r"^ +\[(\d+)(?:\.\.(\d+))?\]", text, re.MULTILINE):
        found += range(int(first), int(last or first) + 1)
    return found


ENVS = {
    "goal": {"worlds": "playground/train-1"},
    "blob": {"worlds": "playground/train-1", "observation": "blob"},
    "hover": {"task": flockstep.HoverConfig(), "drone": "f550"},  # six rotors
    "memory": {
        "task": flockstep.HoverConfig(),
        "control": "body_rates",
        "observed": flockstep.ObservationConfig(history=3, past_actions=2, age=True, delay_s=0.02),
    },
    "track": {"task": flockstep.TrackConfig(points=3)},
    "race": {"task": flockstep.RaceConfig(gates_ahead=3), "worlds": "race/figure-8"},
    "swap": {"task": flockstep.SwapConfig(neighbors=2), "drones_per_env": 4},
}


@pytest.mark.parametrize("kind", ENVS)
def test_every_number_of_an_observation_is_named(kind, tmp_path):
    envs = flockstep.DroneVectorEnv(2, autoreset_mode="same_step", **ENVS[kind])
    model = PPO("MlpPolicy", envs, policy_kwargs=NET, **SMALL)
    flockstep.export(model, tmp_path / "policy.h")
    flockstep.export(model, tmp_path / "policy.onnx", env=flockstep.sb3.DroneVecEnv(envs))
    text = (tmp_path / "policy.h").read_text()
    (size,) = envs.single_observation_space.shape
    assert listed(text) == [*range(size)]
    assert max(map(len, text.splitlines())) <= 120
    words = onnx.load(tmp_path / "policy.onnx").graph.doc_string
    assert listed(words) == [*range(size)]
    if kind == "memory":
        for part in ("[9..11]  angular velocity, in units of 10 rad/s", "[16..47]", "[48..55]", "[56]", "0.02 s late"):
            assert part in text
        assert "control 'body_rates', 50 actions" in text


def test_a_task_in_python_has_names_alone(tmp_path):
    model = PPO("MultiInputPolicy", Still(DICT), **SMALL)
    flockstep.export(model, tmp_path / "policy.h")
    assert listed((tmp_path / "policy.h").read_text()) == [*range(5)]


# --- refusals


@pytest.mark.parametrize("path", ["policy", "policy.hpp", "my-policy.h", "9.h", ".h", "ü.h"])
def test_a_path_is_refused(path, tmp_path):
    with refused(ValueError, "path"):
        flockstep.export(flockstep.policies.load("hover"), tmp_path / path)
    assert not [*tmp_path.iterdir()]


def test_what_a_header_cannot_hold_is_refused(tmp_path):
    image, sb3 = spaces.Box(0, 255, (3, 36, 36), np.uint8), stable_baselines3
    for word, model in [
        ("NatureCNN", sb3.PPO("CnnPolicy", Still(image))),
        ("NatureCNN", sb3.PPO("MultiInputPolicy", Still(spaces.Dict({"seen": image, "more": box(2)})))),
        ("an image", sb3.PPO("MlpPolicy", Still(image))),
        ("memory", sb3_contrib.RecurrentPPO("MlpLstmPolicy", Still())),
        ("MultiDiscrete", sb3.PPO("MlpPolicy", Still(None, spaces.MultiDiscrete([2, 3])))),
        ("Discrete(4)", sb3.PPO("MlpPolicy", Still(spaces.Discrete(4)))),
        ("LeakyReLU", sb3.PPO("MlpPolicy", Still(), policy_kwargs={"activation_fn": torch.nn.LeakyReLU})),
        ("QRDQNPolicy", sb3_contrib.QRDQN("MlpPolicy", Still(None, spaces.Discrete(3)))),
    ]:
        with pytest.raises(ValueError, match=rf"^(model|actions|observation).*: expected.*{re.escape(word)}"):
            flockstep.export(model, tmp_path / "policy.h")
    broken = sb3.PPO("MlpPolicy", Still())
    with torch.no_grad():
        broken.policy.action_net.weight[0, 0] = torch.nan
    with refused(ValueError, "model"):
        flockstep.export(broken, tmp_path / "policy.h")
    for value in (None, "hover", torch.nn.Linear(2, 2), lambda rows: rows):
        with refused(TypeError, "model"):
            flockstep.export(value, tmp_path / "policy.h")
    assert not [*tmp_path.iterdir()]


def test_another_env_is_refused(tmp_path):
    model = flockstep.policies.load("hover")
    for env in (hover(1, control="body_rates", observed=flockstep.ObservationConfig(history=2)), Aim(), "hover"):
        with refused(ValueError, "env"):
            flockstep.export(model, tmp_path / "policy.h", env=env)
    closed = hover(1)
    closed.close()
    with pytest.raises(flockstep.errors.ClosedError):
        flockstep.export(model, tmp_path / "policy.h", env=closed)
    assert not [*tmp_path.iterdir()]
    trained = PPO("MlpPolicy", hover(4), **SMALL)
    trained.env.close()
    flockstep.export(trained, tmp_path / "trained.h")
    flockstep.export(model, tmp_path / "policy.h", env=gymnasium.make("flockstep/Hover-v0"))
    assert "offset to the point" in (tmp_path / "policy.h").read_text()
    with refused(ValueError, "model"):
        both = VecNormalize(DummyVecEnv([lambda: Still(box(3))]))
        flockstep.export(PPO("MlpPolicy", both, normalize_observations=True, **SMALL), tmp_path / "other.h")
