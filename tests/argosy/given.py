"""Async tests that are given what a context manager opens for them."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from contextlib import AbstractAsyncContextManager
from inspect import Signature, signature
from typing import Any

from tests.support.buses import async_test


def given(
    opens: Callable[[], AbstractAsyncContextManager[Any]],
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run an async test with what `opens()` gives as its first parameter; the others are fixtures."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        async def everything(**values: Any) -> None:
            async with opens() as one:
                await test(one, **values)

        everything.__name__, everything.__doc__, everything.__module__ = test.__name__, test.__doc__, test.__module__
        everything.__signature__ = Signature(list(signature(test).parameters.values())[1:])  # type: ignore[attr-defined]
        return async_test(everything)

    return decorate
