"""Watch envs in a browser while a program steps them: a server of the page, and of moments for it."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import secrets
import socket
import sys
import threading
import time
import weakref
import webbrowser
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from flockstep.pictures.shown import Actions
from flockstep.recordings.capture import arrays_in, contents_of, step_seconds
from flockstep.recordings.moment import Moments
from flockstep.recordings.recording import Contents, Recording
from flockstep.vector_env import DroneVectorEnv
from flockstep.viewer import page
from flockstep.viewer.packing import Had, pack

_RATE_HZ = 30.0
#: Share of the program's time that reading moments may take; the rest of what a watched training may lose is for
#: packing them, in another thread.
_SHARE = 0.05
_MOST_PAGES = 8
_MOST_UNANSWERED = 2  # moments on their way to a page
_MOST_WORLDS = 32  # of a page; then it gets a new flight
_MOST_LOOKS = 256  # the same of moving objects
_MOST_MESSAGE_BYTES = 4096
_STICKS_LAST_S = 0.5
_CTRL_C_S = 0.2  # longest wait: so short that Ctrl-C ends it on every system
_PLACE = "default-src 'none';"  # in the page's Content-Security-Policy


class LiveView:
    """Shows envs in a browser while a program steps them; `flockstep.view` makes it.

    Attributes
    ----------
    address
        The page, with the token that it needs.
    names
        Names of an env's drones in the page, the first drone's first. Default: none; their numbers are shown.
    """

    def __init__(self, envs: DroneVectorEnv, local_port: int, flies: bool, real_time: bool) -> None:
        serve = require()
        self._query = f"token={secrets.token_urlsafe(16)}"
        self._num_envs, self._step_s = envs.num_groups, step_seconds(envs)
        source = json.dumps({"envs": envs.num_groups, "flies": flies})
        self._socket = socket.create_server(("127.0.0.1", local_port))
        host = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self.address = f"http://{host}/?{self._query}"
        self._origins = {f"http://{host}", f"http://localhost:{host.rpartition(':')[2]}"}
        self._page = page.with_block(f'<script type="application/json" id="live">{source}</script>').replace(
            _PLACE, f"{_PLACE} connect-src ws://{host} ws://localhost:{host.rpartition(':')[2]};"
        )
        # Pages come and go on the thread of the server; the program's thread reads this tuple.
        self._pages: tuple[_Page, ...] = ()
        self._changed = threading.Condition()
        self._begins_timed = self._is_timed = flies or real_time
        self._is_paused, self._allowed = False, 0
        self._steps, self._moment, self._due = 0, 0, 0.0
        self.names: tuple[str, ...] = ()
        self._stick_values, self._sticks_at, self._resets = (0.0, 0.0, 0.0, 0.0), -math.inf, False
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, args=(serve,), name="flockstep view", daemon=True)
        self._envs = weakref.ref(envs, lambda _: self.close())
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """True while the page is served."""
        return not self._ended.is_set()

    @property
    def is_watched(self) -> bool:
        """True while a page is open."""
        return bool(self._pages)

    def sticks(self) -> tuple[float, float, float, float]:
        """Return throttle, roll, pitch and yaw in [-1, 1], from a page; zeros if it has been silent for 0.5 s."""
        is_late = time.monotonic() - self._sticks_at > _STICKS_LAST_S
        return (0.0, 0.0, 0.0, 0.0) if is_late else self._stick_values

    def take_reset(self) -> bool:
        """Return whether a page has asked for a reset since the last call."""
        asked, self._resets = self._resets, False
        return asked

    def wait(self) -> None:
        """Wait until a page is open, or the view is closed."""
        with self._changed:
            while self.is_open and not self.is_watched:
                self._changed.wait(_CTRL_C_S)

    def close(self) -> None:
        """End the server. A program that a page has paused goes on."""
        envs = self._envs()
        if envs is not None and envs._live is self:
            envs._live = envs._watched = None
        with self._changed:
            self._is_paused = False
            self._changed.notify_all()
        with suppress(RuntimeError):  # it is closed already
            self._loop.call_soon_threadsafe(self._ended.set)
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<LiveView at {self.address}>"

    # --- on the thread that steps the envs

    def flown(self, actions: Actions = None, steps: int = 1) -> None:
        """Show the moment after steps of all envs, and wait while a page holds the program."""
        self._steps += steps
        self.begun(actions)
        if self._is_paused or self._is_timed:
            self._hold(actions, steps)

    def begun(self, actions: Actions = None) -> None:
        """Show the moment, such as after a reset."""
        self._moment += 1
        self._show(actions)

    def _show(self, actions: Actions) -> None:
        envs, moment = self._envs(), (self._moment, self._steps * self._step_s)
        if envs is None:
            return
        for each in self._pages:
            taken = each.take(envs, actions, *moment, self._is_paused)
            if taken is not None:
                with suppress(RuntimeError):  # the server has just ended
                    self._loop.call_soon_threadsafe(each.moments.put_nowait, taken)

    def _hold(self, actions: Actions, steps: int) -> None:
        with self._changed:
            while self._is_paused and self._allowed == 0:
                self._show(actions)  # a page may have chosen another env
                self._changed.wait(_CTRL_C_S)
            self._allowed = max(self._allowed - 1, 0)
        if self._is_timed:
            now = time.monotonic()
            self._due = max(self._due + steps * self._step_s, now - 0.1)
            time.sleep(max(self._due - now, 0.0))

    # --- on the thread of the server

    def _run(self, serve: Callable[..., Any]) -> None:
        logger = logging.getLogger("flockstep.viewer.server")
        logger.propagate = False  # of strangers' connections nothing is said
        options = {"max_size": _MOST_MESSAGE_BYTES, "compression": None, "logger": logger, "server_header": None}

        async def run() -> None:
            async with serve(self._meet, sock=self._socket, process_request=self._answer, **options):
                await self._ended.wait()

        try:
            self._loop.run_until_complete(run())
        finally:
            self._loop.close()

    def _answer(self, connection: Any, request: Any) -> Any:
        """Answer a request for the page, refuse strangers, or return None for a WebSocket."""
        asked = urlsplit(request.path)
        if not secrets.compare_digest(asked.query.encode(), self._query.encode()):
            return connection.respond(403, "open the whole address that flockstep printed, with its token\n")
        if not self._origins.issuperset(request.headers.get_all("Origin")):
            return connection.respond(403, "Origin: expected the page of this address\n")
        if asked.path == "/live":
            return None
        if asked.path != "/":
            return connection.respond(404, "expected / or /live\n")
        response = connection.respond(200, self._page)
        del response.headers["Content-Type"]
        headers = {"Content-Type": "text/html; charset=utf-8", "Cache-Control": "no-store"}
        response.headers.update(headers | {"Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff"})
        return response

    async def _meet(self, connection: Any) -> None:
        """Serve one page until it is closed."""
        from websockets.exceptions import ConnectionClosed

        envs = self._envs()
        if len(self._pages) >= _MOST_PAGES or envs is None:
            await connection.close(1013, f"At most {_MOST_PAGES} pages can watch")
            return
        opened = _Page(connection)
        sending = asyncio.create_task(opened.send_all())
        envs._watched = self
        with self._changed:
            self._pages = (*self._pages, opened)
            self._changed.notify_all()
        del envs  # the server keeps no envs alive
        try:
            await self._say()
            async for text in connection:
                if self._obey(opened, text):
                    await self._say()
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            self._pages = tuple(each for each in self._pages if each is not opened)
            if not self._pages:
                self._leave()

    def _leave(self) -> None:
        envs = self._envs()
        if envs is not None:
            envs._watched = None
        with self._changed:
            self._is_paused, self._is_timed = False, self._begins_timed
            self._changed.notify_all()

    async def _say(self) -> None:
        for each in self._pages:
            status = {"env": each.env, "paused": self._is_paused, "real_time": self._is_timed, "names": self.names}
            with suppress(Exception):  # it is closing, which its own task notices
                await each.connection.send(json.dumps(status))

    def _obey(self, sender: _Page, text: str | bytes) -> bool:
        """Do what a page asks for; what is not understood does nothing. Return whether pages need to know."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return False
        if not isinstance(message, Mapping):
            return False
        env, sticks = message.get("env"), message.get("sticks")
        if message.get("got") is True:
            sender.answered = min(sender.answered + 1, sender.taken)
        if type(env) is int and 0 <= env < self._num_envs:
            sender.env = env
        if isinstance(sticks, list) and len(sticks) == 4 and all(map(_is_stick, sticks)):
            throttle, roll, pitch, yaw = map(float, sticks)
            self._stick_values, self._sticks_at = (throttle, roll, pitch, yaw), time.monotonic()
        self._resets |= message.get("reset") is True
        with self._changed:
            if type(message.get("paused")) is bool:
                self._is_paused, self._allowed = message["paused"], 0
            if type(message.get("real_time")) is bool:
                self._is_timed, self._due = message["real_time"], 0.0
            if message.get("step") is True:
                self._allowed = self._allowed + 1 if self._is_paused else 0
                self._is_paused = True
            self._changed.notify_all()
        return not message.keys().isdisjoint(("env", "paused", "real_time", "step"))


class _Page:
    """One open page: the env that it watches, and how far it is."""

    def __init__(self, connection: Any) -> None:
        self.connection, self.env = connection, 0
        self.moments: asyncio.Queue[tuple[Contents, bool]] = asyncio.Queue()  # at most _MOST_UNANSWERED
        self.taken = self.answered = 0
        self._had = Had()
        self._source: Moments | None = None
        self._contents: Contents | None = None  # without moments
        self._ended: npt.NDArray[np.bool_] | None = None
        self._due, self._moment, self._began_s = 0.0, -1, 0.0

    def take(
        self, envs: DroneVectorEnv, actions: Actions, moment: int, time_s: float, is_forced: bool
    ) -> tuple[Contents, bool] | None:
        """Read the moment of the watched env, and whether a flight begins with it; None if none is due."""
        source, now = self._source, time.perf_counter()
        begins = source is None or source.first != self.env
        if self.taken - self.answered >= _MOST_UNANSWERED or not (begins or is_forced or now >= self._due):
            return None
        if moment == self._moment and not begins:
            return None  # the page of a paused program has it
        is_full = source is not None and (len(source.worlds) > _MOST_WORLDS or len(source.bodies) > _MOST_LOOKS)
        if source is None or self._contents is None or begins or is_full:
            worlds = {} if source is None or len(source.worlds) > _MOST_WORLDS else source.worlds
            source, begins, self._began_s = Moments(envs.batch, 1, self.env), True, time_s
            source.worlds, self._ended = worlds, None
            self._source, self._contents = source, contents_of(envs, source)
        arrays, images = source.now()
        arrays |= arrays_in(envs, source, actions() if callable(actions) else actions)
        contents = replace(
            self._contents,
            arrays={name: values[None] for name, values in arrays.items()},
            images=images,
            worlds=dict(source.worlds),
            bodies=list(source.bodies),
            times_s=np.array([time_s - self._began_s]),
            ended_before=self._ended,
        )
        flags = arrays["terminated"].astype(bool) | arrays["truncated"].astype(bool)
        self._ended = flags & self._contents.repeats_ends
        self.taken, self._moment = self.taken + 1, moment
        self._due = now + max(1 / _RATE_HZ, (time.perf_counter() - now) / _SHARE)
        return contents, begins

    async def send_all(self) -> None:
        """Pack and send what is taken."""
        from websockets.exceptions import ConnectionClosed

        try:
            while True:
                contents, begins = await self.moments.get()
                had = self._had
                if begins:
                    had = Had(worlds=had.worlds if had.worlds <= len(contents.worlds) else 0)
                data = pack(Recording._of(contents), had)
                images = {name: had.images.get(name, 0) + len(files) for name, files in contents.images.items()}
                self._had = Had(True, len(contents.worlds), len(contents.bodies), images)
                await self.connection.send(data)
        except ConnectionClosed:
            pass
        except Exception as error:
            logging.getLogger(__name__).exception("a moment cannot be shown")
            await self.connection.close(1011, f"{type(error).__name__}: {error}"[:60])


def _is_stick(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -1 <= value <= 1


def require() -> Callable[..., Any]:
    """Return what makes servers, or raise ModuleNotFoundError without websockets, FileNotFoundError without a page."""
    page.template()
    try:
        from websockets.asyncio.server import serve
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "the live view needs websockets >= 14, which is not installed: pip install 'flockstep[client]'",
            name="websockets",
        ) from error
    return serve


def view(
    envs: Any, *, local_port: int = 0, browser: bool = True, flies: bool = False, real_time: bool = False
) -> LiveView:
    """Show envs in a browser while your program steps them, trains in them or evaluates a policy in them.

    The page has one env at a time. It can pause the program between two env steps, step it, and slow it down to the
    speed of flight. When the last page is closed, the program goes on at full speed.

    >>> with flockstep.view(envs) as live:
    ...     print(live.address)
    ...     model.learn(1_000_000)

    Parameters
    ----------
    envs
        A `DroneVectorEnv`, a `DroneEnv`, a ``VecEnv`` of `flockstep.sb3`, or one of these in wrappers.
    local_port
        Port on 127.0.0.1. 0: any free one.
    browser
        Open a browser if there is a display; without one, print the address.
    flies
        Send sticks from the page, for `LiveView.sticks`, and step at the speed of flight.
    real_time
        Step at the speed of flight while a page is open, unless it chooses otherwise.

    Returns
    -------
    LiveView
        Serves the page until its ``close()``, or that of the envs.

    Raises
    ------
    TypeError
        The envs are others.
    ValueError
        The envs are closed, or have a view already.
    OSError
        The port is taken.
    ModuleNotFoundError
        websockets is not installed, which the extra ``client`` installs.
    """
    found = _found(envs)
    if found.closed:
        raise ValueError("envs: expected open envs, got closed ones")
    if found._live is not None:
        raise ValueError(f"envs: expected envs without a view, got envs with one at {found._live.address}")
    is_number = isinstance(local_port, (int, np.integer)) and not isinstance(local_port, bool)
    if not is_number or not 0 <= local_port < 1 << 16:
        raise ValueError(f"local_port: expected an integer from 0 to 65535, got {local_port!r}")
    made = found._live = LiveView(found, int(local_port), flies, real_time)
    if browser:
        _open(made.address)
    return made


def _found(envs: Any) -> DroneVectorEnv:
    """Return the `DroneVectorEnv` in wrappers."""
    inner = envs
    for name in ("unwrapped", "envs", "env"):  # the last two of `DroneEnv`, `SideBySide` and `DroneVecEnv`
        inner = inner if isinstance(inner, DroneVectorEnv) else getattr(inner, name, inner)
        inner = _found(inner[0]) if isinstance(inner, tuple) and inner else inner
    if not isinstance(inner, DroneVectorEnv):
        raise TypeError(f"envs: expected a DroneVectorEnv, a DroneEnv or a VecEnv of flockstep, got {envs!r}"[:200])
    return inner


def _open(url: str) -> None:
    """Open a browser without waiting for it, or print the address."""
    if page.has_display():
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    else:
        print(f"flockstep: watch at {url}", file=sys.stderr, flush=True)
