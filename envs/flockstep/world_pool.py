"""Worlds without end, built ahead in the background; every episode draws one."""

from __future__ import annotations

import contextlib
import math
import threading
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from numbers import Real
from typing import Any, TypeAlias

import numpy as np

from flockstep._core import World

#: How hard world number k is: a function of k, or (first, last, over), which goes evenly from the one to the other.
Difficulty: TypeAlias = Callable[[int], float] | tuple[float, float, int]

_MOST = 1 << 24  # as many worlds as a draw can tell apart


class WorldPool:
    """An endless series of worlds, number 0, 1, 2, ..., of which every episode draws one: ``worlds=`` of an env.

    >>> pool = flockstep.WorldPool(lambda number: flockstep.World.playground(seed=number), size=64, fresh=0.1)
    >>> envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", num_envs=1024, worlds=pool)

    Episode n of an env is flown in world number ``floor(n * fresh) + floor(u * size)``, where u in [0, 1) is drawn by
    the env's seed and n alone. Worlds are built on threads in the background, beginning with those that the next
    episodes draw. A reset or step that needs one that is not ready waits for it, so the same seeds give the same bits,
    however long a world takes.

    Parameters
    ----------
    make
        Returns the `World` of a number, the same one whenever it is called. With a ``difficulty``, it is called with
        the number and its difficulty.
    size
        How many worlds are drawn from, from 1 to 2**24.
    fresh
        How many new worlds take the place of the oldest from one episode of an env to the next, from 0 to 2**24. With
        0, the same ``size`` worlds are drawn from for ever.
    difficulty
        Where ``fresh`` is more than 0, this is a curriculum: a function of the number, or a schedule
        ``(first, last, over)``, which goes evenly from ``first``, for world 0, to ``last``, for world ``over`` and all
        after it.
    threads
        That build: ``make`` is called on so many at once.
    """

    def __init__(
        self,
        make: Callable[..., World],
        size: int = 64,
        fresh: float = 0.0,
        *,
        difficulty: Difficulty | None = None,
        threads: int = 1,
    ) -> None:
        if not callable(make):
            raise TypeError(f"make: expected a function of a number that returns a World, got {make!r}")
        self.make: Callable[..., World] = make
        self.size: int = _integer("size", size, _MOST)
        self.fresh: float = _fresh(fresh)
        self.difficulty: Difficulty | None = _difficulty(difficulty)
        self.threads: int = _integer("threads", threads, 1024)

    def __repr__(self) -> str:
        return f"WorldPool({self.make!r}, size={self.size}, fresh={self.fresh})"

    def difficulty_of(self, number: int) -> float:
        """Return the difficulty of a world, 0 where the pool has none."""
        if self.difficulty is None:
            return 0.0
        if callable(self.difficulty):
            value = self.difficulty(number)
            if not _is_number(value):
                raise ValueError(f"difficulty: expected a function that returns finite numbers, got {value!r}")
            return value
        first, last, over = self.difficulty
        return first + (last - first) * min(number / over, 1.0)

    def world(self, number: int) -> World:
        """Return the world of a number, which is made now.

        Raises
        ------
        RuntimeError
            ``make`` raised something, which is the cause of this.
        TypeError
            ``make`` returned something else.
        """
        try:
            made = self.make(number) if self.difficulty is None else self.make(number, self.difficulty_of(number))
        except Exception as error:
            raise RuntimeError(f"WorldPool: making world {number} raised {type(error).__name__}: {error}") from error
        if not isinstance(made, World):
            raise TypeError(f"WorldPool: world {number}: expected that make returns a flockstep.World, got {made!r}")
        return made


class Builds:
    """The worlds of a pool that one batch needs now or soon: those that are built, and those that will be.

    It keeps as many as a draw chooses from, and one for each env. What has not been asked for the longest goes first;
    it is made anew where it is asked for again. Called by the batch, by one thread at a time.
    """

    def __init__(self, pool: WorldPool, num_envs: int, prepare: Callable[[World], None]) -> None:
        self._pool = pool
        self._prepare = prepare  # what the batch would else do in the middle of a step
        self._most = pool.size + num_envs
        self._builds: OrderedDict[int, Future[World]] = OrderedDict()
        self._line = _Line(pool.threads)
        weakref.finalize(self, self._line.close)

    def want(self, numbers: Sequence[int]) -> None:
        """Build these worlds, after those that have been wanted before."""
        for number in numbers:
            self._build(number)

    def get(self, number: int) -> World:
        """Return a world; wait until it is built. What has failed is tried again the next time."""
        build = self._build(number)
        try:
            return build.result()
        finally:
            if build.done() and build.exception() is not None:
                del self._builds[number]

    def _build(self, number: int) -> Future[World]:
        if number in self._builds:
            self._builds.move_to_end(number)
            return self._builds[number]
        build = self._builds[number] = Future()
        pool, prepare = self._pool, self._prepare  # not self: what waits must not keep it
        self._line.add(lambda: _run(build, pool, prepare, number))
        while len(self._builds) > self._most:
            _, oldest = self._builds.popitem(last=False)
            oldest.cancel()  # unless it has begun
        return build


class _Line:
    """What is to be done in turn, on some threads in the background.

    Each piece is handed to the executor when one before it is done. An executor finishes all that it has been given
    before the program may end, and takes no more from then on: so no more is begun.
    """

    def __init__(self, threads: int) -> None:
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix="flockstep-world")
        self._lock = threading.Lock()
        self._waiting: deque[Callable[[], None]] = deque()
        self._idle = threads

    def add(self, work: Callable[[], None]) -> None:
        with self._lock:
            self._waiting.append(work)
            if self._idle == 0:
                return
            self._idle -= 1
        self._executor.submit(self._next)

    def close(self) -> None:
        """Begin nothing more. The executor's threads go with it, once they are through with what they are at.

        This may be called by the garbage collector, in whatever a thread is at, also while it holds the locks of this
        line or of any executor. So it takes none, and leaves it to the executor to end with its last reference.
        """
        self._waiting.clear()

    def _next(self) -> None:
        with self._lock:
            try:
                work = self._waiting.popleft()
            except IndexError:  # none, or closed just now
                self._idle += 1
                return
        work()
        del work  # and what it holds
        with contextlib.suppress(RuntimeError):  # the program is ending
            self._executor.submit(self._next)


def _run(build: Future[World], pool: WorldPool, prepare: Callable[[World], None], number: int) -> None:
    if not build.set_running_or_notify_cancel():
        return
    try:
        world = pool.world(number)
        prepare(world)
    except BaseException as error:
        build.set_exception(error)
    else:
        build.set_result(world)


def _integer(name: str, value: Any, most: int) -> int:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not 1 <= value <= most:
        raise ValueError(f"{name}: expected an integer in [1, {most}], got {value!r}")
    return int(value)


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)


def _fresh(value: Any) -> float:
    if not _is_number(value) or not 0 <= float(value) <= _MOST:
        raise ValueError(f"fresh: expected a number in [0, {_MOST}], got {value!r}")
    return float(value)


def _difficulty(given: Any) -> Difficulty | None:
    if given is None or callable(given):
        function: Callable[[int], float] | None = given
        return function
    expected = "a function of a number, or (first, last, over) with over >= 1"
    if not isinstance(given, Sequence) or len(given) != 3 or not all(isinstance(value, Real) for value in given):
        raise TypeError(f"difficulty: expected {expected}, got {given!r}")
    first, last, over = given
    if not _is_number(first) or not _is_number(last):
        raise ValueError(f"difficulty: expected finite numbers as first and last, got {given!r}")
    return float(first), float(last), _integer("difficulty: over", over, 1 << 31)
