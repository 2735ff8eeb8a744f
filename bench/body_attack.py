"""Calls `batch.bodies` at random, often with invalid values, and checks what must hold after every call.

`./dev try attacks [--calls 1000000]` runs it at length. A refused call changes nothing: neither the arrays, nor a
snapshot, nor what a twin that is restored from it does next. No call crashes, hangs or leaves a value that is not
finite, and each concerns only the bodies that it selects.
"""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

import flockstep
from flockstep import BodyConfig, BodyMotion

ROOM = {
    "flockstep_scene": 1,
    "room": {"min": [0, 0, 0], "max": [12, 12, 6]},
    "pillars": [{"center": [8, 8], "radius": 0.4}],
    "markers": {"start": [5, 6, 3]},
}
SHAPES = ("box", "cylinder", "sphere", "capsule")
BODY_ARRAYS = ("active", "position", "quat_wxyz", "velocity", "angular_velocity", "scripted")
LONGEST_CALL_S = 30.0
CALLS_PER_BATCH = 150
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-3, 1e-45, 1e5, 1e6, 1e9, -1e9, 1e38, 1e300, np.nan, np.inf, -np.inf)

Attempt = Callable[[], object]


class Attack:
    """Random calls of one batch."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.counts: Counter[str] = Counter()
        self.make = self.maker()
        self.batch = self.make()
        self.blobs = [self.batch.snapshot()]

    def maker(self) -> Callable[[], flockstep.Batch]:
        num_envs = int(self.random.choice([1, 2, 5]))
        slots = int(self.random.choice([1, 3, 8, 100]))
        if self.random.random() < 0.03:
            num_envs, slots = 1, 1000
        bodies = [self.valid_body() for _ in range(int(self.random.integers(0, slots + 1)))]
        settings: dict[str, Any] = {
            "drones_per_env": int(self.random.choice([1, 2])),
            "bodies": bodies,
            "max_bodies": slots,
            "lidar": flockstep.LidarConfig(beams=16, max_range_m=20),
            "cameras": [flockstep.CameraConfig(width_px=8, height_px=6, outputs=["rgb", "depth", "instance"])],
            "num_threads": 1,
        }
        self.has_rotors = self.random.random() < 0.4
        if self.has_rotors:
            on_contact = str(self.random.choice(["terminate", "stop", "bounce"]))
            settings["dynamics"] = flockstep.DynamicsConfig(motion="rotors", control="velocity", on_contact=on_contact)
            settings["clock"] = flockstep.ClockConfig(policy_hz=50)
        world = flockstep.World.from_dict(ROOM)
        return lambda: flockstep.Batch([world], num_envs * settings["drones_per_env"], **settings)

    # -- Values

    def chance(self, share: float) -> bool:
        return bool(self.random.random() < share)

    def number(self) -> float:
        return float(self.random.choice(NUMBERS)) if self.chance(0.5) else float(self.random.normal(0, 5))

    def wild(self, shape: tuple[int, ...], good: Any, wildness: float = 0.4) -> Any:
        """Return `good`, an array of this shape, or something made from it that may be invalid."""
        if not self.chance(wildness):
            return good
        value = np.array(good)
        kinds = ["?", "i1", "u8", "f2", "f8", "c8", "O", "U8", "M8[s]"]
        spoiled: list[Callable[[], Any]] = [
            lambda: self.scattered(value.astype(np.float64)),
            lambda: np.full(shape, self.number()),
            lambda: np.atleast_1d(value)[..., :-1],
            lambda: np.zeros(tuple(int(n) for n in self.random.integers(0, 6, self.random.integers(0, 5)))),
            lambda: value[None] if self.chance(0.5) else value.ravel(),
            lambda: value.astype(self.random.choice(kinds)),
            lambda: np.asfortranarray(value),
            lambda: np.repeat(np.atleast_1d(value), 2, axis=-1)[..., ::2],  # not contiguous
            lambda: value.tolist(),
            lambda: self.random.choice(np.array([None, 0, 1, 10**9, -1, "bodies"], object)),
            lambda: [[1, 2], [3]],
            lambda: np.frombuffer(value.tobytes(), value.dtype).reshape(value.shape),  # not writeable
        ]
        return spoiled[self.random.integers(0, len(spoiled))]()

    def scattered(self, value: Any) -> Any:
        """Replace some numbers of an array."""
        for _ in range(int(self.random.integers(1, 4)) if value.size else 0):
            value.flat[self.random.integers(0, value.size)] = self.number()
        return value

    def mask(self, *, of_bodies: bool) -> Any:
        envs, slots = self.batch.bodies.active.shape
        shape = (envs, slots) if of_bodies and self.chance(0.6) else (envs,)
        if self.chance(0.2):
            return None
        good = self.random.random(shape) < self.random.random()
        if self.chance(0.15):
            shape = (*shape[:-1], shape[-1] + int(self.random.integers(-1, 2)))
            return self.wild(shape, np.ones(shape, bool))
        return self.wild(shape, good, 0.2)

    def rotations(self, *shape: int) -> Any:
        q = self.random.normal(size=(*shape, 4))
        return (q / np.linalg.norm(q, axis=-1, keepdims=True)).astype(np.float32)

    def vectors(self, *shape: int, scale: float) -> Any:
        return self.random.normal(0, scale, (*shape, 3)).astype(np.float32)

    def places(self, *shape: int) -> Any:
        scale = float(self.random.choice([1, 1, 1, 100, 1e5]))
        near = self.batch.position.reshape(-1, 3)[0] if self.chance(0.3) else np.float32([5, 6, 3])
        return (near + self.random.normal(0, scale, (*shape, 3))).astype(np.float32)

    def valid_fields(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the fields of a configuration, and those of its motion."""
        shape = str(self.random.choice(SHAPES))
        size = np.exp(self.random.uniform(np.log(1e-3), np.log(1e5 if self.chance(0.1) else 3), 3))
        if shape != "box":
            size[1] = size[0]
        if shape == "sphere":
            size[2] = size[0]
        if shape == "capsule":
            size[2] = max(size[0], size[2])
        size = np.clip(np.float32(size), np.float32(1e-3), np.float32(1e5))
        where = self.random.uniform([1, 1, 1], [11, 11, 5])
        kind = str(self.random.choice(["velocity", "waypoints", "orbit", "hinge", "slider", "random_walk"]))
        spots = self.random.uniform(0, 12, (int(self.random.integers(2, 6)), 3))
        box = np.sort(self.random.uniform(0, 12, (2, 3)), axis=0)
        motion = {
            "kind": kind,
            "velocity_mps": self.random.normal(0, 3, 3),
            "turn_rate_dps": self.random.normal(0, 90, 3),
            "points_m": spots if kind == "waypoints" else np.zeros((0, 3)),
            "route": str(self.random.choice(["loop", "back_and_forth", "once"])),
            "speed_mps": float(self.random.choice([0, 1, 50, 1e4])),
            "corner_radius_m": float(self.random.choice([0, 0.5, 1e5])),
            "faces_travel": self.chance(0.5),
            "center_m": where if self.chance(0.5) else self.random.uniform(0, 12, 3),  # an orbit of radius 0
            "axis": self.random.normal(size=3),
            "period_s": float(self.random.choice([1e-3, 0.1, 10, 1e6])),
            "angle_deg": float(self.random.choice([0, -90, 180, 360])),
            "travel_m": self.random.normal(0, 3, 3) if self.chance(0.8) else np.zeros(3),
            "box_min_m": box[0],
            "box_max_m": box[1] if self.chance(0.8) else box[0],
            "phase": float(self.random.choice([0, 0.3, 1])),
            "random_phase": self.chance(0.5),
            "speed_spread": float(self.random.choice([0, 0.5, 0.999])),
        }
        is_mesh = self.chance(0.15)
        body = {
            "name": "body",
            "shape": "mesh" if is_mesh else shape,
            "size_m": np.ones(3) if is_mesh else size,
            "mesh": self.mesh() if is_mesh else None,
            "position_m": where,
            "quat_wxyz": self.rotations(),
            "color": self.random.uniform(0, 1, 3),
            "semantic": int(self.random.integers(0, 100)),
            "visibility": str(self.random.choice(["full", "full", "visual", "solid"])),
        }
        return body, motion

    def mesh(self) -> flockstep.World:
        """Return a world of a few triangles."""
        builder = flockstep.WorldBuilder()
        material = builder.material("steel")
        corners = self.random.normal(0, np.exp(self.random.uniform(-6, 2)), (12, 3))
        builder.mesh(corners, np.arange(12).reshape(4, 3), material)
        return builder.build()

    def valid_body(self) -> BodyConfig:
        """Return a body that contacts can follow at 10 ticks per second."""
        body, motion = self.valid_fields()
        motion |= {"period_s": 600.0, "speed_mps": 0.5}
        return BodyConfig(**body, motion=BodyMotion(**motion))

    def any_body(self) -> Any:
        body, motion = self.valid_fields()
        if self.chance(0.3):
            fields = motion if self.chance(0.6) else body
            name = str(self.random.choice(list(fields)))
            value: Any = np.asarray(fields[name])
            wrong: Any = self.wild(value.shape, value, 1.0)
            if self.chance(0.3):
                wrong = self.random.choice(np.array(["", "cone", "a b", "\0", "x" * 10_000], object))
            fields[name] = wrong
        if self.chance(0.05):
            body["mesh"] = flockstep.World.from_dict(ROOM)
        if self.chance(0.02):
            return self.random.choice(np.array([None, 3, "ball"], object))
        return BodyConfig(**body, motion=BodyMotion(**motion))

    # -- Calls

    def rows(self, *shape: int, **chances: float) -> dict[str, Any]:
        """Return some of these arguments of a call, with values for each env or body that may be invalid."""
        make: dict[str, Callable[[], Any]] = {
            "position": lambda: self.places(*shape),
            "quat_wxyz": lambda: self.rotations(*shape),
            "velocity": lambda: self.vectors(*shape, scale=float(self.random.choice([1, 50, 3000, 1e9]))),
            "angular_velocity": lambda: self.vectors(*shape, scale=10),
        }
        goods = {name: make[name]() for name, chance in chances.items() if self.chance(chance)}
        return {name: self.wild(good.shape, good) for name, good in goods.items()}

    def spawn(self) -> None:
        envs, _ = self.batch.bodies.active.shape
        rows = self.rows(envs, position=0.6, quat_wxyz=0.4, velocity=0.4, angular_velocity=0.4)
        if self.chance(0.3):
            rows["position"] = self.batch.position.reshape(envs, -1, 3)[:, 0]  # on top of a drone
        rows["mask"] = self.mask(of_bodies=False)
        active = self.batch.bodies.active.copy()
        slots = self.batch.bodies.spawn(self.any_body(), **rows)
        selected = np.ones(envs, bool) if rows["mask"] is None else np.array(rows["mask"], bool)
        assert ((slots >= 0) == selected).all(), "spawned where it was selected"
        for env in np.flatnonzero(selected):
            assert slots[env] == np.argmin(active[env]), "spawned into the first free slot"
            active[env, slots[env]] = True
        assert (self.batch.bodies.active == active).all()

    def remove(self) -> None:
        self.concern_selected("remove")

    def set_pose(self) -> None:
        self.concern_selected("set_pose", position=0.8, quat_wxyz=0.5)

    def set_velocity(self) -> None:
        self.concern_selected("set_velocity", velocity=0.8, angular_velocity=0.5)

    def concern_selected(self, call: str, **chances: float) -> None:
        """Make a call, and check that it has changed only active bodies that it selects."""
        bodies, mask = self.batch.bodies, self.mask(of_bodies=True)
        rows = self.rows(*bodies.active.shape, **chances)
        before = {name: getattr(bodies, name).copy() for name in BODY_ARRAYS}
        getattr(bodies, call)(**rows, mask=mask)
        selected = np.ones(before["active"].shape, bool)
        if mask is not None:
            selected &= np.array(mask, bool).reshape(len(selected), -1)
        selected &= before["active"]
        for name, array in before.items():
            now = getattr(bodies, name)
            assert (now[~selected] == array[~selected]).all(), f"{call} changed {name} of others"
            if name in rows and rows[name] is not None and name != "quat_wxyz":
                given = np.array(rows[name], np.float32)
                assert (now[selected] == given[selected]).all(), f"{call} set another {name}"
        if call == "remove":
            assert not bodies.active[selected].any()

    def config(self) -> None:
        envs, slots = self.batch.bodies.active.shape
        env, body = (
            self.random.choice(np.array([0, size - 1, size, -1, 2**40, 1.5, "0", None], object))
            for size in (envs, slots)
        )
        config = self.batch.bodies.config(env, body)
        assert (config is not None) == self.batch.bodies.active[env, body]

    def fly(self) -> None:
        """Fly the drones, past bodies that have changed since the last scan."""
        for _ in range(int(self.random.integers(1, 4))):
            if self.has_rotors:
                self.batch.fly(self.random.normal(0, 2, (self.batch.num_drones, 4)).astype(np.float32))
            else:
                self.batch.move(self.batch.position + self.vectors(self.batch.num_drones, scale=0.1))
        self.batch.sense()

    def begin_episode(self) -> None:
        self.batch.begin_episode(self.random.random(len(self.batch.bodies.active)) < 0.5)

    def snapshot(self) -> None:
        self.blobs = [*self.blobs[-3:], self.batch.snapshot()]

    def restore(self) -> None:
        blob = self.blobs[self.random.integers(0, len(self.blobs))]
        if self.chance(0.3):
            damaged = bytearray(blob)
            damaged[self.random.integers(0, len(damaged))] ^= 1 << self.random.integers(0, 8)
            blob = bytes(damaged)
        self.batch.restore(blob)
        assert self.batch.snapshot() == blob

    def remove_all(self) -> None:
        """Remove all bodies between two scans: the second one is that of an empty world."""
        self.batch.sense()
        self.batch.bodies.remove()
        bare = flockstep.Batch(
            [flockstep.World.from_dict(ROOM)], self.batch.num_drones, lidar=self.batch.lidar().config, num_threads=1
        )
        position, quat_wxyz = self.batch.position.copy(), self.batch.quat_wxyz.copy()
        for batch in (self.batch, bare):
            batch.set_pose(position, quat_wxyz)
            batch.sense()
        assert self.batch.lidar().ranges.tobytes() == bare.lidar().ranges.tobytes()

    # -- Checks

    def everything(self) -> dict[str, bytes]:
        """Return the snapshot and all arrays that concern bodies, as bytes."""
        batch = self.batch
        arrays = {name: getattr(batch.bodies, name) for name in BODY_ARRAYS}
        arrays |= {name: getattr(batch, name) for name in ("position", "quat_wxyz")}
        arrays |= {name: getattr(batch.contact, name) for name in ("hit", "inside", "point", "normal", "body")}
        camera = batch.camera()
        arrays |= {name: getattr(camera, name) for name in ("rgb", "depth", "instance", "frame_step")}
        if self.counts["sensed"]:
            arrays["ranges"] = batch.lidar().ranges
        return {"snapshot": batch.snapshot()} | {name: array.tobytes() for name, array in arrays.items()}

    def check_values(self) -> None:
        bodies, batch = self.batch.bodies, self.batch
        for name in ("position", "quat_wxyz", "velocity", "angular_velocity"):
            assert np.isfinite(getattr(bodies, name)).all(), name
        assert np.isfinite(batch.position).all()
        assert np.isfinite(batch.quat_wxyz).all()
        norms = np.linalg.norm(bodies.quat_wxyz[bodies.active].astype(float), axis=-1)
        assert (np.abs(norms - 1) < 1e-5).all()
        assert (np.abs(bodies.position[bodies.active]) <= 1e6).all()
        for env, body in zip(*np.nonzero(~bodies.active), strict=True):
            assert bodies.config(int(env), int(body)) is None
            break

    def check_twin(self) -> None:
        """A batch that is restored from a snapshot goes on as this one does."""
        twin = self.make()
        twin.restore(self.batch.snapshot())
        command = self.random.normal(0, 1, (self.batch.num_drones, 4)).astype(np.float32)
        for batch in (self.batch, twin):
            batch.sense()
            if self.has_rotors:
                batch.fly(command)
            else:
                batch.move(batch.position + command[:, :3])
            batch.sense()
        assert self.batch.lidar().ranges.tobytes() == twin.lidar().ranges.tobytes()
        assert self.batch.camera().depth.tobytes() == twin.camera().depth.tobytes()
        assert self.batch.snapshot() == twin.snapshot()

    def call(self) -> None:
        """Make one random call and check its effects."""
        weights = {
            self.spawn: 6,
            self.set_pose: 4,
            self.set_velocity: 4,
            self.remove: 2,
            self.config: 2,
            self.fly: 4,
            self.begin_episode: 0.5,
            self.snapshot: 0.5,
            self.restore: 0.7,
            self.remove_all: 0.2,
            self.check_twin: 0.4,
        }
        chosen = list(weights)[
            self.random.choice(len(weights), p=np.array([*weights.values()]) / sum(weights.values()))
        ]
        before = self.everything()
        started = time.perf_counter()
        try:
            chosen()
        except (ValueError, TypeError, OverflowError):
            self.counts["refused"] += 1
            changed = [name for name, value in self.everything().items() if value != before[name]]
            assert not changed, f"a refused {chosen.__name__} changed {changed}"
        else:
            self.counts["accepted"] += 1
            self.counts[f"accepted {chosen.__name__}"] += 1
            self.counts["sensed"] += chosen in (self.fly, self.remove_all, self.check_twin)
        took = time.perf_counter() - started
        assert took < LONGEST_CALL_S, f"{chosen.__name__} took {took:.0f} s"
        self.check_values()


def run(calls: int, seed: int = 0) -> Counter[str]:
    """Make random calls of batches, and return how many of each kind were accepted or refused."""
    total: Counter[str] = Counter()
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of NumPy, which converts the values
        while total["accepted"] + total["refused"] < calls:
            attack = Attack(seed)
            for number in range(CALLS_PER_BATCH):
                try:
                    attack.call()
                except Exception as error:
                    raise AssertionError(f"call {number} of seed {seed}: {error}") from error
            total += attack.counts
            seed += 1
    return total
