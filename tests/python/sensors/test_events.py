"""Event cameras: counts of events against a NumPy twin of v2e's model, with the same random words, and statistics."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import world_of
from messages import refused
from philox import named_stream, philox
from simple_tasks import Still

import flockstep
from flockstep import CameraConfig, EventPixels

ROOM = world_of(
    name="room",
    room={"min": [0, 0, 0], "max": [8, 8, 4]},
    boxes=[{"center": [6, 4, 1.5], "size": [0.3, 0.4, 3], "material": "dark"}],
    materials={"default": {"base_color": [0.8, 0.8, 0.8]}, "dark": {"base_color": [0.05, 0.05, 0.05]}},
    markers={"start": [4, 4, 2]},
)
TICKS, TICK_S = 10, 0.002  # of a step
EVERY = {"threshold": 0.1, "threshold_std": 0.03, "refractory_s": 0.05, "leak_hz": 5.0, "shot_hz": 20.0}
MODELS = {
    "default": {},
    "spread": {"threshold_std": 0.05},
    "refractory": {"threshold": 0.02, "refractory_s": 0.005},
    "long refractory": {"threshold": 0.02, "refractory_s": 0.07},
    "leak": {"leak_hz": 30.0},
    "shot": {"shot_hz": 300.0},
    "every": EVERY,
}


def flying(model=None, num_envs=2, *, camera=None, **keywords):
    """Return drones that fly random commands before an event camera."""
    image = {"width_px": 13, "height_px": 9, "outputs": ("grey", "events"), **(camera or {})}
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.HoverConfig(),
        worlds=ROOM,
        policy_hz=50,
        camera=CameraConfig(**image, event_pixels=EventPixels(**(model or {}))),
        **{"max_episode_steps": 12, "autoreset_mode": "same_step", **keywords},
    )


def flight(env, steps=30, seed=3):
    """Return the images of all steps, and the numbers of their episodes and of the steps in these."""
    rng, found = np.random.default_rng(0), []
    env.reset(seed=seed)
    batch, camera = env.batch, env.batch.camera()
    names = (*camera.config.outputs, "episode", "steps")
    for step in range(steps + 1):
        if step:
            env.step(np.float32(rng.uniform(-1, 1, env.action_space.shape)))
        found.append([getattr(batch if hasattr(batch, name) else camera, name).copy() for name in names])
    return SimpleNamespace(**{name: np.stack(x) for name, x in zip(names, zip(*found, strict=True), strict=True)})


def words(pixels, tick, seed, episode, member=0):
    """Return two random words (P, 2) for each pixel of an image."""
    draws = (pixels + 1) // 2
    index = (np.arange(draws, dtype=np.uint64) + np.uint64(draws * tick)) & np.uint64(0xFFFFFFFF)
    drawn = philox([index, named_stream("events of camera.front"), episode, member << 12], [seed, 0])
    return np.stack(np.broadcast_arrays(*drawn), axis=1).reshape(-1, 2)[:pixels]


class Twin:
    """The pixels of one camera, from their documented equations, in float32."""

    def __init__(self, model, grey, seed, episode):
        self.model, self.key = EventPixels(**model), (seed, episode)
        levels = np.arange(256.0)
        self.log = np.where(levels <= 20, levels * np.log(20) / 20, np.log(np.maximum(levels, 1))).astype(np.float32)
        self.reference = self.log[grey]
        self.idle = np.full(grey.size, 1e6, np.float32)
        a, b = words(grey.size, 0, *self.key).T
        radius = np.sqrt(-2 * np.log((a + 1.0) / 2**32))
        normal = np.stack([radius * f(2 * np.pi * b / 2**32) for f in (np.cos, np.sin)]).astype(np.float32)
        threshold, spread = np.float32(self.model.threshold), np.float32(self.model.threshold_std)
        self.thresholds = np.maximum(threshold + spread * normal, np.float32(0.01))

    def events(self, grey, tick):
        """Return the counts (P, 2) of ON and OFF events in a step that ends at this tick."""
        f = np.float32
        model, elapsed = self.model, f(TICKS * TICK_S)
        on, off = self.thresholds
        self.reference = self.reference - f(model.leak_hz) * elapsed * on
        change = self.log[grey] - self.reference
        threshold = np.where(change > 0, on, off)
        count = np.minimum(np.floor(np.abs(change) / threshold), f(255))
        if model.refractory_s > 0:
            count = np.array([self.keep(i, n, elapsed) for i, n in enumerate(count)], f)
        self.reference = self.reference + np.copysign(count * threshold, change)
        counts = np.stack([np.where(change > 0, count, 0), np.where(change > 0, 0, count)], axis=1)
        if model.shot_hz > 0:
            uniform = (words(grey.size, tick, *self.key) >> np.uint64(8)).astype(f) / f(2**24)
            counts += np.floor(f(0.5) * f(model.shot_hz) * elapsed + uniform)
        return np.minimum(counts, 255)

    def keep(self, pixel, count, elapsed):
        """Walk through evenly spaced crossings, and keep those that are late enough after the one before."""
        last, kept = -float(self.idle[pixel]), 0
        for k in range(1, int(count) + 1):
            at = k * float(elapsed) / count
            if at - last >= self.model.refractory_s - 1e-4 * float(elapsed) / count:
                last, kept = at, kept + 1
        self.idle[pixel] = min(float(elapsed) - last, 1e6)
        return kept


@pytest.mark.parametrize("name", MODELS)
def test_events_are_those_of_the_twin(name):
    model = MODELS[name]
    seen = flight(flying(model))
    wrong, total = 0, np.zeros(2)
    for env in (0, 1):
        for grey, events, episode, step in zip(
            seen.grey[:, env], seen.events[:, env], seen.episode[:, env], seen.steps[:, env], strict=True
        ):
            if step == 0:
                twin = Twin(model, grey.ravel(), 3 + env, int(episode))
                assert not events.any()
                continue
            expected = twin.events(grey.ravel(), int(step) * TICKS)
            got = events.reshape(-1, 2)
            wrong += (got != expected).sum()
            total += got.sum(axis=0)
    assert total.min() > 100
    assert wrong <= (1e-3 * seen.events.size if "threshold_std" in model else 0)  # logarithms of libraries differ
    assert (seen.steps == 0).sum() >= 4  # episodes


def test_layouts_and_sizes_have_the_same_events():
    def events(**camera):
        return flight(flying(EVERY, camera=camera)).events

    both = events()
    np.testing.assert_array_equal(np.moveaxis(events(layout="chw"), 2, -1), both)
    np.testing.assert_array_equal(events(outputs=("events",)), both)
    small = {"width_px": 26, "height_px": 18, "resize": (13, 9)}
    resized = events(**small)
    np.testing.assert_array_equal(events(**small, outputs=("events",)), resized)
    assert resized.sum() > 1000


def test_events_do_not_depend_on_threads():
    one, three = (flight(flying(EVERY, 4, num_threads=threads)).events for threads in (1, 3))
    np.testing.assert_array_equal(one, three)


@pytest.mark.parametrize("late", [{}, {"latency_s": 0.05, "jitter_s": 0.04}], ids=["at once", "late"])
def test_a_snapshot_continues(late):
    env = flying(EVERY, camera=late)
    flight(env, 7)
    blob, shown = env.batch.snapshot(), env.batch.camera().events.copy()
    actions = np.float32(np.random.default_rng(5).uniform(-1, 1, (9, *env.action_space.shape)))

    def go():
        found = []
        for action in actions:
            env.step(action)
            found.append(env.batch.camera().events.copy())
        return np.stack(found)

    first = go()
    assert first.any()
    env.batch.restore(blob)
    np.testing.assert_array_equal(env.batch.camera().events, shown)
    np.testing.assert_array_equal(go(), first)


def test_late_images_have_the_events_of_punctual_ones():
    punctual = flight(flying(EVERY))
    late = flight(flying(EVERY, camera={"latency_s": 2 * TICKS * TICK_S}))
    for k, env in np.argwhere(punctual.steps >= 2):
        np.testing.assert_array_equal(late.events[k, env], punctual.events[k - 2, env])


def still(model, steps=100):
    """Return the sums of events (H, W, 2) before a wall that does not move, in 2 s."""
    camera = CameraConfig(width_px=32, height_px=32, outputs=("events",), event_pixels=EventPixels(**model))
    env = flockstep.DroneVectorEnv(1, task=Still(), worlds=ROOM, policy_hz=50, camera=camera, max_episode_steps=500)
    env.reset(seed=1)
    total = np.zeros((32, 32, 2))
    for _ in range(steps):
        env.step(np.zeros_like(env.action_space.sample()))
        total += env.batch.camera().events[0]
    return total


def test_nothing_happens_in_a_still_scene():
    assert not still({"threshold": 0.01}).any()


def test_rates_of_leak_and_noise():
    leak = still({"leak_hz": 8.0})
    assert abs(leak[..., 0].mean() - 16) <= 1  # in 2 s, less the first threshold
    assert not leak[..., 1].any()
    shot = still({"shot_hz": 30.0})
    np.testing.assert_allclose(shot.mean(axis=(0, 1)), 30, rtol=0.02)
    assert abs(np.corrcoef(shot[..., 0].ravel(), shot[..., 1].ravel())[0, 1]) < 0.15


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("threshold", 0.0),
        ("threshold", float("nan")),
        ("threshold_std", -0.1),
        ("refractory_s", -1e-3),
        ("refractory_s", float("inf")),
        ("leak_hz", 1e4),
        ("shot_hz", -1.0),
    ],
)
def test_bad_models(field, value):
    with refused(ValueError, f"camera.event_pixels.{field}"):
        CameraConfig(event_pixels=EventPixels(**{field: value}))


def test_extreme_models_stay_within_their_counts():
    model = {"threshold": 0.01, "leak_hz": 1000.0, "shot_hz": 1000.0}
    assert flight(flying(model)).events.max() > 20
    assert flight(flying({**model, "threshold_std": 10.0, "refractory_s": 1.0})).events.any()
