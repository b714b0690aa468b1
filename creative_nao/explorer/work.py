"""Work that takes seconds: how far it is, and calling it off when nobody waits for it any more."""

from __future__ import annotations

from collections.abc import Iterator


class Work:
    """One computation in a thread, watched from the page.

    Attributes:
        share: How much of it is done, 0 to 1.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self.called_off = False

    def call_off(self) -> None:
        """Let it end at its next step; what it then returns is None."""
        self.called_off = True

    def rows(self, n: int, block: int, begin: float = 0.0, end: float = 1.0) -> Iterator[slice]:
        """Give the rows of n things block by block, until they are done or the work is called off.

        Args:
            n: How many there are.
            block: How many at a time.
            begin: The share of the work done before the first of them.
            end: The share done after the last.
        """
        for start in range(0, n, block):
            if self.called_off:
                return
            yield slice(start, min(start + block, n))
            self.share = begin + (end - begin) * min(start + block, n) / n
