"""Laws and parameters that are refused, and curricula, which change the laws during a training."""

import numpy as np
import pytest
from messages import refused
from rigid_body import batch_of, plain
from variation_rows import row

import flockstep
from flockstep import vary
from flockstep.variations import Curriculum, controllers, presets, ramp


@pytest.mark.parametrize(
    ("laws", "field", "values"),
    [
        ({"mass_scale": (1.2, 0.8)}, "variations.low", [1.2]),
        ({"mass_scale": (0.0, 1.0)}, "variations", ["mass_scale", 0]),
        ({"mass_scale": (0.8, float("nan"))}, "variations.high", ["nan"]),
        ({"mas_scale": (0.8, 1.2)}, "variations.parameter", ["mass_scale", "mas_scale"]),
        ({"action_delay_s": (0.0, 1.5)}, "variations", ["action_delay_s", 1.5]),
        ({"mass_scale": (0.8, 10.0)}, "variations", ["weight"]),
        ({"airframe": 3.0}, "variations", ["airframe", 3]),
        ({"thrust_scale": {"law": "log_uniform", "low": -1.0}}, "variations.low", ["log_uniform", -1]),
    ],
)
def test_bad_laws_are_refused(laws, field, values):
    with refused(ValueError, field, *values):
        made = {name: flockstep.Variation(**law) if isinstance(law, dict) else law for name, law in laws.items()}
        flockstep.DroneVectorEnv(num_envs=1, task=flockstep.HoverConfig(), variations=vary(**made))


def test_bad_params_are_refused_before_anything_changes():
    batch = batch_of(plain(), 2, variations=vary(mass_scale=(0.9, 1.1), action_delay_s=(0.0, 0.01)))
    before = batch.params.copy()
    for wrong, values in (
        ({"mass_scale": np.nan}, ["mass_scale", "nan"]),
        ({"thrust_scale": 1.1}, ["thrust_scale", 1.1]),
        ({"action_delay_s": 0.02}, ["action_delay_s", 0.02]),
    ):
        with refused(ValueError, "params", *values):
            batch.set_params(np.stack([row(), row(**wrong)]))
        np.testing.assert_array_equal(batch.params, before)
    with refused(ValueError, "variations", "rotors"):
        flockstep.Batch([flockstep.World.load("playground/train-1")], 1, variations=vary(mass_scale=1.1))


def test_a_curriculum_changes_the_laws():
    easy, hard = vary(mass_scale=(1.0, 1.0), thrust_scale=1.0), vary(mass_scale=(0.5, 1.5), thrust_scale=1.5)
    envs = flockstep.DroneVectorEnv(
        num_envs=32, task=flockstep.HoverConfig(), variations=easy, max_episode_steps=4, autoreset_mode="same_step"
    )
    model = flockstep.PPO("MlpPolicy", envs, n_steps=8, batch_size=256, n_epochs=1)
    seen = []

    def schedule(done):
        seen.append((done, envs.batch.params[:, :1].copy()))
        return ramp(easy, hard, until=0.5)(done)

    model.learn(8 * 32 * 5, Curriculum(envs, schedule), log_interval=None)
    assert [done for done, _ in seen] == [0, 0.2, 0.4, 0.6, 0.8]
    for i, width in ((1, 0.0), (2, 0.2), (3, 0.4), (4, 0.5)):
        off = np.abs(seen[i][1] - 1.0).max()
        assert 0.7 * width <= off <= width + 1e-6
    assert [law.high for law in envs.batch.variations] == [1.5, 1.5]
    before = envs.batch.variations
    for laws, words in (
        (vary(mass_scale=1.0), ["thrust_scale"]),
        (vary(mass_scale=1.0, thrust_scale=1.0, lag_up_scale=1.0), ["lag_up_scale"]),
        (vary(mass_scale=1.0, thrust_scale=0.1), ["weight"]),
    ):
        with refused(ValueError, "variations", *words):
            envs.batch.set_variations(laws)
        assert envs.batch.variations == before
    with refused(TypeError, "schedule", None):
        model.learn(256, Curriculum(envs, lambda done: None), log_interval=None)
    with refused(ValueError, "first, last", "mass_scale"):
        ramp(easy, vary(mass_scale=1.0))
    envs.close()
    late = batch_of(plain(), 2, variations=vary(action_delay_s=(0.0, 0.01)))
    with refused(ValueError, "variations", "action_delay_s", 0.02):
        late.set_variations(vary(action_delay_s=(0.0, 0.02)))


def test_misspelt_names_are_refused():
    with refused(ValueError, "presets", *presets, "diffaeros"):
        presets["diffaeros"]
    with refused(ValueError, "controllers", *controllers, "px5"):
        controllers["px5"]


def test_other_constants_act_from_the_next_episode():
    heavy = vary(mass_scale=1.3)
    changed, made = (
        flockstep.DroneVectorEnv(20, task=flockstep.HoverConfig(), variations=laws)
        for laws in (vary(mass_scale=1.0), heavy)
    )
    changed.reset(seed=1)
    changed.batch.set_variations(heavy)
    for envs in (changed, made):
        envs.reset(seed=2)
        for _ in range(20):
            envs.step(np.zeros((20, 4), np.float32))
    assert np.array_equal(changed.batch.velocity, made.batch.velocity)
