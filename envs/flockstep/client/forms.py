"""The two forms of an operation: one waits for the reply, one is for asyncio. Both are made from one function.

A class lists its operations as methods that return a `Call`, marked with `operation` or `stream`. Its subclasses that
are also `Waits` or `Awaits` get the method that carries the call out, with the same parameters and text.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Coroutine
from functools import update_wrapper
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

from flockstep.client import changes
from flockstep.client.call import Call, Subscription
from flockstep.client.streams import AsyncStream, Stream
from flockstep.keywords import with_keywords

P = ParamSpec("P")
T = TypeVar("T")


class operation(Generic[P, T]):  # noqa: N801 # a decorator
    """Marks a method that returns the `Call` of an operation."""

    def __init__(self, make: Callable[Concatenate[Any, P], Call[T]]) -> None:
        self.make = make

    @overload
    def __get__(self, client: Waits, owner: Any = None) -> Callable[P, T]: ...
    @overload
    def __get__(self, client: Awaits, owner: Any = None) -> Callable[P, Coroutine[Any, Any, T]]: ...
    def __get__(self, client: Any, owner: Any = None) -> Any:
        raise AttributeError("a class with operations must be Waits or Awaits")

    def method(self, is_async: bool) -> Callable[..., Any]:
        """Return the method that carries the call out."""
        make = self.make

        def waits(client: Waits, /, *args: Any, **keywords: Any) -> T:
            return client._call(make(client, *args, **keywords))

        async def awaits(client: Awaits, /, *args: Any, **keywords: Any) -> T:
            return await client._call(make(client, *args, **keywords))

        return _like(make, awaits if is_async else waits, "{}", is_async)


class stream(Generic[P, T]):  # noqa: N801 # a decorator
    """Marks a method that returns the `Subscription` of a stream."""

    def __init__(self, make: Callable[Concatenate[Any, P], Subscription[T]]) -> None:
        self.make = make

    @overload
    def __get__(self, client: Waits, owner: Any = None) -> Callable[P, Stream[T]]: ...
    @overload
    def __get__(self, client: Awaits, owner: Any = None) -> Callable[P, AsyncStream[T]]: ...
    def __get__(self, client: Any, owner: Any = None) -> Any:
        raise AttributeError("a class with streams must be Waits or Awaits")

    def method(self, is_async: bool) -> Callable[..., Any]:
        """Return the method that subscribes."""
        make = self.make

        def subscribes(client: Any, /, *args: Any, **keywords: Any) -> Any:
            return client._subscribe(make(client, *args, **keywords))

        return _like(make, subscribes, "AsyncStream[{}]" if is_async else "Stream[{}]", is_async)


class _Form:
    """Makes methods of the operations that other bases of a class list."""

    def __init_subclass__(cls) -> None:
        listed = {name: entry for base in reversed(cls.__mro__) for name, entry in vars(base).items()}
        for name, entry in listed.items():
            if isinstance(entry, (operation, stream)):
                setattr(cls, name, entry.method(issubclass(cls, Awaits)))


class Waits(_Form):
    """A base of classes whose operations wait for the reply."""

    def _call(self, call: Call[T]) -> T:
        raise NotImplementedError

    def _subscribe(self, subscription: Subscription[T]) -> Stream[T]:
        raise NotImplementedError


class Awaits(_Form):
    """A base of classes whose operations are for asyncio."""

    async def _call(self, call: Call[T]) -> T:
        raise NotImplementedError

    def _subscribe(self, subscription: Subscription[T]) -> AsyncStream[T]:
        raise NotImplementedError


def _like(make: Callable[..., Any], method: Callable[..., Any], result: str, is_async: bool) -> Callable[..., Any]:
    """Return a method with the name, text and signature of the function that makes its call."""
    signature, text = inspect.signature(make), make.__doc__ or ""
    if found := re.fullmatch(r"Unpack\[(\w+)\]", str([*signature.parameters.values()][-1].annotation)):
        signature, about = with_keywords(signature, getattr(changes, found[1]))
        text = text.partition("        **fields\n")[0] + textwrap.indent(about, "    ") + "\n        "
    inner = str(signature.return_annotation).partition("[")[2].removesuffix("]")  # T of Call[T]
    inner = inner.replace("_Drone", "AsyncDrone" if is_async else "Drone")
    method.__signature__ = signature.replace(return_annotation=result.format(inner))  # type: ignore[attr-defined]
    update_wrapper(method, make).__annotations__ = {}
    method.__doc__ = text
    del method.__wrapped__  # type: ignore[attr-defined]
    return method
