"""How far a run or a sweep has come, for whoever watches."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, int], None]


def recording_reporter(progress: Progress | None, number: int, total: int) -> Callable[[float], None]:
    """Takes the share done of one recording and tells the recordings done.

    Args:
        progress: called with the recordings done, fractions included, and their number; None for nobody.
        number: recordings done before this one.
        total: recordings in all.
    """

    def report(share: float) -> None:
        if progress is not None:
            progress(number + share, total)

    return report
