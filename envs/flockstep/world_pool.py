"""Endless worlds, built ahead in the background, from which every episode draws one."""

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

#: Difficulty of world k: a function of k, or (first, last, over), a linear schedule from first to last.
Difficulty: TypeAlias = Callable[[int], float] | tuple[float, float, int]

_MOST = 1 << 24  # maximum number of worlds that one draw can distinguish


class WorldPool:
    """An endless series of worlds with numbers 0, 1, 2, ...; every episode of an env with ``worlds=pool`` draws one.

    >>> pool = flockstep.WorldPool(lambda number: flockstep.World.playground(seed=number), size=64, fresh=0.1)
    >>> envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", num_envs=1024, worlds=pool)

    Episode n of an env uses world number ``floor(n * fresh) + floor(u * size)``, with u in [0, 1) drawn from only the
    env's seed and n. Background threads build the worlds, beginning with those of the next episodes. A reset or step
    that needs an unfinished world waits for it, so the results do not depend on how long the worlds take to build.

    Parameters
    ----------
    make
        A function that maps a number to a `World`. The same number must always give the same world. With a
        ``difficulty``, it is called with the number and its difficulty.
    size
        Number of worlds that a draw selects from, 1 to 2**24.
    fresh
        Average number of new worlds per episode of an env, 0 to 2**24. New worlds replace the oldest ones. With 0, the
        same ``size`` worlds are used forever.
    difficulty
        Difficulty of each world: a function of its number, or a linear schedule ``(first, last, over)``. The schedule
        begins with ``first`` at world 0, and reaches ``last`` at world number ``over`` and keeps it. With ``fresh``
        above 0 this is a curriculum.
    threads
        Number of building threads, which call ``make`` in parallel.
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
            raise TypeError(f"make: expected a function from a number to a World, got {make!r}")
        self.make: Callable[..., World] = make
        self.size: int = _integer("size", size, _MOST)
        self.fresh: float = _fresh(fresh)
        self.difficulty: Difficulty | None = _difficulty(difficulty)
        self.threads: int = _integer("threads", threads, 1024)

    def __repr__(self) -> str:
        return f"WorldPool({self.make!r}, size={self.size}, fresh={self.fresh})"

    def difficulty_of(self, number: int) -> float:
        """Return the difficulty of a world, or 0 if the pool has none."""
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
        """Make and return the world with this number.

        Raises
        ------
        RuntimeError
            ``make`` raised an exception, which is the cause of this one.
        TypeError
            ``make`` did not return a `World`.
        """
        try:
            made = self.make(number) if self.difficulty is None else self.make(number, self.difficulty_of(number))
        except Exception as error:
            raise RuntimeError(f"WorldPool: making world {number} raised {type(error).__name__}: {error}") from error
        if not isinstance(made, World):
            raise TypeError(f"WorldPool: world {number}: expected a flockstep.World from make, got {made!r}")
        return made


class Builds:
    """The worlds of a pool that one batch needs now or soon: finished and pending ones.

    It keeps as many worlds as a draw selects from, plus one for each env. The least recently requested world is evicted
    and made again on the next request. Only the batch calls it, from one thread at a time.
    """

    def __init__(self, pool: WorldPool, num_envs: int, prepare: Callable[[World], None]) -> None:
        self._pool = pool
        self._prepare = prepare  # work that the batch would otherwise do during a step
        self._most = pool.size + num_envs
        self._builds: OrderedDict[int, Future[World]] = OrderedDict()
        self._line = _Line(pool.threads)
        weakref.finalize(self, self._line.close)

    def want(self, numbers: Sequence[int]) -> None:
        """Build these worlds, after all earlier requests."""
        for number in numbers:
            self._build(number)

    def get(self, number: int) -> World:
        """Return a world; wait until it is built. A failed build is tried again on the next request."""
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
        pool, prepare = self._pool, self._prepare  # not self: queued work must not keep it alive
        self._line.add(lambda: _run(build, pool, prepare, number))
        while len(self._builds) > self._most:
            _, oldest = self._builds.popitem(last=False)
            oldest.cancel()  # has no effect once the build has begun
        return build


class _Line:
    """A queue of work for some background threads.

    Each piece is handed to the executor when an earlier one is done. At the end of the program an executor finishes all
    its submitted work and accepts no more, so no further piece is begun.
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
        """Begin no more work. The executor's threads end after their current work.

        The garbage collector may call this at any point of a thread, even while the thread holds the locks of this
        queue or of any executor. Therefore it takes no lock, and the executor ends with its last reference.
        """
        self._waiting.clear()

    def _next(self) -> None:
        with self._lock:
            try:
                work = self._waiting.popleft()
            except IndexError:  # empty, or just closed
                self._idle += 1
                return
        work()
        del work  # releases the objects it holds
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
    expected = "a function of the world's number, or (first, last, over) with over >= 1"
    if not isinstance(given, Sequence) or len(given) != 3 or not all(isinstance(value, Real) for value in given):
        raise TypeError(f"difficulty: expected {expected}, got {given!r}")
    first, last, over = given
    if not _is_number(first) or not _is_number(last):
        raise ValueError(f"difficulty: expected finite numbers as first and last, got {given!r}")
    return float(first), float(last), _integer("difficulty: over", over, 1 << 31)
