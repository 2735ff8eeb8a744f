"""`check_vector_env` finds the fault of each deliberately broken env, and none in good envs."""

import copy

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from messages import refused

import flockstep
from flockstep.rotations import quat_from_rpy
from flockstep.testing import CHECKS, check_vector_env

NEXT, SAME, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED


class Counter(VectorEnv):
    """A good env: counts to a random limit; each subclass below breaks one rule."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    mode = NEXT

    def __init__(self, num_envs):
        self.num_envs = num_envs
        self.metadata = {**self.metadata, "autoreset_mode": self.mode}
        self.render_mode = "rgb_array"
        self.single_observation_space = spaces.Box(0, 100, (2,), np.float32)
        self.single_action_space = spaces.Box(-1, 1, (1,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.generators = [np.random.default_rng() for _ in range(num_envs)]
        self.count, self.limit = np.zeros(num_envs), np.ones(num_envs)
        self.ended = np.zeros(num_envs, bool)

    def begin(self, i):
        self.count[i], self.limit[i] = 0, self.generators[i].integers(2, 9)

    def observe(self):
        return np.stack([self.count, self.limit], axis=1).astype(np.float32)

    def seeded(self, seed, i):
        return np.random.default_rng(seed + i)

    def reset(self, *, seed=None, options=None):
        mask = np.ones(self.num_envs, bool) if not options else options["reset_mask"]
        for i in np.flatnonzero(mask):
            if seed is not None:
                self.generators[i] = self.seeded(seed, i)
            self.begin(i)
        self.ended = self.ended & ~mask
        return self.observe(), {}

    def step(self, actions):
        if np.shape(actions) != (self.num_envs, 1) or not np.isfinite(actions).all():
            raise ValueError("actions")
        before = self.ended if self.mode is not SAME else np.zeros_like(self.ended)
        self.count = self.count + ~before * (1 + (np.asarray(actions)[:, 0] > 0))
        ended = ~before & (self.count >= self.limit)
        reward = np.where(before, 0, self.count).astype(np.float32)
        infos = {"count": self.count.copy(), "_count": ended.copy()} if ended.any() else {}
        if self.mode is SAME and ended.any():
            final = np.full(self.num_envs, None, object)
            for i in np.flatnonzero(ended):
                final[i] = self.observe()[i]
            infos = {"final_obs": final, "_final_obs": ended.copy(), "final_info": infos, "_final_info": ended.copy()}
        for i in np.flatnonzero({NEXT: before, SAME: ended}.get(self.mode, np.zeros_like(ended))):
            self.begin(i)
        self.ended = ended if self.mode is not DISABLED else self.ended | ended
        return self.observe(), reward, ended.copy(), np.zeros(self.num_envs, bool), infos

    def render(self):
        return tuple(np.zeros((8, 8, 3), np.uint8) for _ in range(self.num_envs))

    def snapshot(self):
        return copy.deepcopy((self.generators, self.count, self.limit, self.ended))

    def restore(self, blob):
        self.generators, self.count, self.limit, self.ended = copy.deepcopy(blob)


class ForgetsRandom(Counter):
    def snapshot(self):
        return copy.deepcopy((self.count, self.limit, self.ended))

    def restore(self, blob):
        self.count, self.limit, self.ended = copy.deepcopy(blob)


class ForgetsElsewhere(ForgetsRandom):
    """Keeps its generators only in itself, not in the snapshot."""

    def snapshot(self):
        self.kept = copy.deepcopy(self.generators)
        return super().snapshot()

    def restore(self, blob):
        super().restore(blob)
        self.generators = copy.deepcopy(getattr(self, "kept", self.generators))


class SameStepCounter(Counter):
    mode = SAME


class DisabledCounter(Counter):
    mode = DISABLED


@pytest.mark.parametrize("env", [Counter, SameStepCounter, DisabledCounter])
def test_a_good_env_passes(env):
    check_vector_env(env)


@pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED])
def test_gymnasiums_own_envs_pass_except_for_two_known_faults(mode):
    def make(n):
        return gymnasium.make_vec("CartPole-v1", n, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode})

    check_vector_env(make, skip={"reset_mask"})
    if mode is DISABLED:
        with refused(AssertionError, "changed the options"):
            check_vector_env(make)


def broken(base=Counter, **members):
    return type("Broken", (base,), members)


def on_step(change, base=Counter):
    def step(self, actions):
        return change(self, *base.step(self, actions))

    return broken(base, step=step)


def with_infos(key, value):
    return on_step(lambda self, o, r, t, u, i: (o, r, t, u, {**i, key: value(self)}))


def returning(part, change, base=Counter):
    """An env whose step returns another observation, reward, terminated, truncated or infos."""

    def changed(self, *step):
        step = dict(zip(("observation", "reward", "terminated", "truncated", "infos"), step, strict=True))
        return tuple((step | {part: change(step[part])}).values())

    return on_step(changed, base)


def with_final(change):
    """A change of a step's result that affects only the final observations."""

    def changed(self, o, r, t, u, i):
        if i:
            i["final_obs"] = np.array([*(None if row is None else change(row) for row in i["final_obs"]), None], object)
            i["final_obs"] = i["final_obs"][:-1]
        return o, r, t, u, i

    return changed


class Reused(Counter):
    """Returns the same buffer every time."""

    def observe(self):
        if not hasattr(self, "buffer"):
            self.buffer = super().observe()
        self.buffer[:] = super().observe()
        return self.buffer


class ReadsBack(Counter):
    """Keeps counting in the returned array."""

    def observe(self):
        self.handed = super().observe()
        return self.handed

    def step(self, actions):
        if hasattr(self, "handed"):
            self.count = self.handed[:, 0].astype(float)
        return super().step(actions)


class SharedGenerator(Counter):
    def seeded(self, seed, i):
        if i == 0:
            self.shared = np.random.default_rng(seed + self.num_envs)
        return self.shared


class SameSeedForAll(Counter):
    def seeded(self, seed, i):
        return np.random.default_rng(seed)


class PopsTheMask(DisabledCounter):
    def reset(self, *, seed=None, options=None):
        given = None if options is None else {"reset_mask": options.pop("reset_mask")}
        return super().reset(seed=seed, options=given)


class IgnoresTheMask(DisabledCounter):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)


class ActsOnResetRows(Counter):
    def step(self, actions):
        waiting = self.ended.copy()
        result = super().step(actions)
        self.limit = self.limit + waiting * (np.asarray(actions)[:, 0] > 0)
        return self.observe(), *result[1:]


class ClosesOnce(Counter):
    def close(self, **kwargs):
        if self.closed:
            raise RuntimeError("closed already")
        self.closed = True


class SharedMetadata(Counter):
    metadata = {"render_modes": ["rgb_array"], "autoreset_mode": NEXT}  # noqa: RUF012

    def __init__(self, num_envs):
        super().__init__(num_envs)
        del self.metadata
        self.metadata["autoreset_mode"] = self.mode


def unbatched_space(self, num_envs):
    Counter.__init__(self, num_envs)
    self.observation_space = self.single_observation_space


def no_mode(self, num_envs):
    Counter.__init__(self, num_envs)
    self.metadata["autoreset_mode"] = "NextStep"


def changes_actions(self, actions):
    result = Counter.step(self, actions)
    actions[:] = 0
    return result


FAULTS = {
    "spaces": [
        (broken(__init__=unbatched_space), "observation_space.*batch_space"),
        (broken(__init__=no_mode), "AutoresetMode.*'NextStep'"),
        (SharedMetadata, "share one metadata"),
        (broken(autoreset_mode=SAME), "attribute autoreset_mode"),
    ],
    "values": [
        (returning("observation", lambda o: o.astype(float)), "observation.*float32.*float64"),
        (
            returning("observation", lambda o: o + np.float32([0, 200]) * (np.arange(4) > 1)[:, None]),
            r"^step 0: observation is not in the observation space: expected numbers in \[0.0, 100.0\], "
            r"got 20\d.0 in env 2 at index \[1\]; 2 of 8 lie outside$",
        ),
        (
            returning("observation", lambda o: o * np.where(np.arange(4) == 3, np.nan, 1)[:, None].astype(o.dtype)),
            r"got nan in env 3 at index \[0\]; 2 of 8 lie outside$",
        ),
        (returning("reward", lambda r: r.astype(int)), "reward.*int64"),
        (
            returning("reward", lambda r: np.where(np.arange(4) % 2, np.inf, r).astype(r.dtype)),
            "reward: expected finite numbers, got inf in env 1; 2 of 4 are not$",
        ),
        (returning("reward", lambda r: r[:1]), r"reward.*shape"),
        (returning("terminated", lambda t: t.astype(int)), "terminated.*bool"),
        (returning("truncated", list), "truncated.*list"),
        (returning("infos", lambda i: []), "infos.*dict"),
        (with_infos("total", lambda s: 3), "infos.*total.*length 4"),
        (with_infos("total", lambda s: np.zeros(3)), "infos.*total.*length 4"),
        (with_infos("_total", lambda s: np.zeros(4, bool)), "mask belongs to no key"),
        (with_infos("_count", lambda s: np.zeros(4, int)), "mask of dtype bool|mask belongs to no key"),
        (with_infos("episode", lambda s: np.zeros(4)), "reserved for RecordEpisodeStatistics"),
    ],
    "determinism": [(broken(seeded=lambda self, seed, i: np.random.default_rng()), "same seed and actions")],
    "num_envs": [(SharedGenerator, "env i of 4 should equal env i of 9")],
    "seed_offset": [(SameSeedForAll, r"seeded s \+ 3")],
    "autoreset": [
        (on_step(lambda s, o, r, t, u, i: (o, r, t & False, u, {})), "no episode ended"),
        (returning("reward", lambda r: r + 1), "reward of the step after"),
        (ActsOnResetRows, "should be ignored"),
        (returning("infos", lambda i: {}, SameStepCounter), "no 'final_obs'"),
        (
            returning("infos", lambda i: i and {**i, "_final_obs": ~i["_final_obs"]}, SameStepCounter),
            "_final_obs.*terminated",
        ),
        (
            on_step(
                lambda s, o, r, t, u, i: (o, r, t, u, i and {**i, "final_obs": np.array([*o, None], object)[:-1]}),
                SameStepCounter,
            ),
            "final_obs.*(object array|its episode continues|view)",
        ),
        (
            on_step(with_final(lambda final: final - 1000), SameStepCounter),
            r"final_obs'\]\[\d\] is not in the observation space: .* got -9\d\d.0 at index \[0\]; 2 of 2 lie outside$",
        ),
    ],
    "reset_mask": [(PopsTheMask, "changed the options"), (IgnoresTheMask, "outside")],
    "snapshot": [
        (ForgetsRandom, "should repeat when the snapshot is restored"),
        (ForgetsElsewhere, "in another env too"),
    ],
    "ownership": [
        (Reused, "written later"),
        (ReadsBack, "wrote into the arrays"),
        (broken(step=changes_actions), "changed the actions"),
    ],
    "bad_actions": [
        (broken(step=lambda self, a: Counter.step(self, np.nan_to_num(a))), "nan"),
        (broken(step=lambda self, a: Counter.step(self, np.asarray(a)[: self.num_envs])), "actions for 5 envs"),
    ],
    "render": [
        (broken(render=lambda self: None), "NoneType"),
        (broken(render=lambda self: Counter.render(self)[:1]), "expected 4 frames"),
        (broken(render=lambda self: tuple(np.zeros((8, 8)) for _ in range(4))), "uint8"),
        (broken(render=lambda self: self.nothing), "^render raised AttributeError.*'nothing'.* after a reset$"),
    ],
    "close": [(ClosesOnce, "closing twice"), (broken(close=lambda self: None), "closed should be True")],
}


class Named(flockstep.Task):
    """Draws, and names the part of its observation that leaves the bounds."""

    observation_space = spaces.Dict(place=spaces.Box(0, 8, (3,)), up=spaces.Box(0, 1, ()))
    beyond = 0.0

    def step(self, batch):
        return np.zeros(batch.num_drones), batch.steps > np.arange(batch.num_drones) % 3 + 1

    def observe(self, batch):
        return {"place": batch.position, "up": np.full(batch.num_drones, self.beyond, np.float32)}

    def draw(self, batch, env, drawing):
        drawing.cells(batch.position[env], 1)


class DrawsInPink(Named):
    def draw(self, batch, env, drawing):
        drawing.cells(batch.position[env], 1, "pink")


@pytest.mark.parametrize("keywords", [{}, {"render_mode": "rgb_array", "render_view": "third_person"}])
def test_the_checker_reports_errors_of_the_draw_method(room, keywords):
    def check(task):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=task, render_size=(32, 24), **keywords),
            skip=set(CHECKS) - {"render"},
        )

    check(Named)
    line = DrawsInPink.draw.__code__.co_firstlineno + 1
    with refused(AssertionError, f"DrawsInPink.draw, line {line}", "ValueError", "pink", "after a reset"):
        check(DrawsInPink)


def test_a_part_of_an_observation_beyond_its_bounds_is_named(room):
    found = type("Beyond", (Named,), {"beyond": 1.5})
    with (
        refused(AssertionError, "reset: observation['up']", 1.5, "env 0"),
        refused(RuntimeWarning, "Beyond.observe", "up", 1.5),
    ):
        check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=found))


class Keeps(Named):
    """Keeps its previous position, as given by ``kept``."""

    kept = staticmethod(lambda batch: batch.position.copy())

    def step(self, batch):
        self.before = self.kept(batch)
        return super().step(batch)


def test_a_view_of_the_batch_that_a_task_keeps_is_named(room):
    def check(task):
        check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=task, lidar=flockstep.LidarConfig()))

    check(Keeps)
    for kept in (
        lambda batch: batch.position,
        lambda batch: batch.position[:, 2:],
        lambda batch: batch.contact.hit,
        lambda batch: {"last": [batch.quat_wxyz, 3]},
        lambda batch: batch.lidar().ranges.reshape(-1),
    ):
        with refused(AssertionError, "Trap.before is a view of the batch", "self.before ="):
            check(type("Trap", (Keeps,), {"kept": staticmethod(kept)}))


class Turning(Named):
    """Turns with its actions. `reset` places the drones without an attitude."""

    action_space = spaces.Box(-1, 1, (3,), np.float32)
    observation_space = spaces.Box(-np.inf, np.inf, (14,), np.float32)
    max_episode_steps = 5

    def reset(self, batch, mask):
        batch.set_pose([2, 2, 1], rows=batch.rows)

    def act(self, batch, actions):
        return batch.position.copy(), quat_from_rpy(actions)

    def observe(self, batch):
        return np.concatenate([batch.position, batch.rotation.reshape(-1, 9), np.zeros((batch.num_drones, 2))], axis=1)


def test_the_attitude_that_a_reset_forgets_is_named(room):
    with refused(AssertionError, "the drones have another rotation", "batch.rotation"):
        check_vector_env(lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=Turning))


def test_several_worlds_differ_by_design_and_the_check_says_so(room, closet):
    def check(**keywords):
        make = lambda n: flockstep.DroneVectorEnv(n, task=Named, **keywords)  # noqa: E731
        check_vector_env(make, skip=set(CHECKS) - {"seed_offset"})

    with refused(AssertionError, "s + 3", "random_world=True", "skip=('seed_offset',)"):
        check(worlds=[room, closet])
    check(worlds=[room, closet], random_world=True)
    check(worlds=room)
    uneven = type(
        "Uneven",
        (Named,),
        {"observe": lambda self, b: {**Named.observe(self, b), "up": np.arange(b.num_drones, dtype="f") / 9}},
    )
    with refused(AssertionError, "seeded s + 3, but"):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=room, task=uneven), skip=set(CHECKS) - {"seed_offset"}
        )


def test_every_check_is_tested():
    assert FAULTS.keys() == CHECKS.keys()


@pytest.mark.parametrize(
    ("check", "env", "message"), [(check, env, message) for check, faults in FAULTS.items() for env, message in faults]
)
def test_a_fault_is_found_and_named(check, env, message):
    with pytest.raises(AssertionError, match=f"(?s){message}"):
        check_vector_env(env, skip=set(CHECKS) - {check})


def test_bad_arguments():
    with refused(ValueError, "skip", "weather"):
        check_vector_env(Counter, skip={"weather"})
    with refused(ValueError, "num_envs"):
        check_vector_env(Counter, num_envs=1)


def test_the_counter_can_be_copied():
    assert copy.deepcopy(Counter(2)).num_envs == 2
