"""Work on many things, some at a time: the compiled parts of it release Python's lock, so threads are enough."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(
    items: Sequence[Item],
    work: Callable[[Item], Result],
    n_workers: int,
    told: Callable[[int, Item], None] = lambda *_: None,
) -> list[Result]:
    """Return the result of each item, in order.

    Args:
        items: What to work on.
        work: The work; it must not depend on the other items.
        n_workers: Items at a time.
        told: Called with how many are done and the last of them.
    """
    with ThreadPoolExecutor(n_workers) as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            results = []
            for place, (item, future) in enumerate(zip(items, futures, strict=True)):
                results.append(future.result())
                told(place + 1, item)
            return results
        except BaseException:
            for future in futures:
                future.cancel()
            raise
