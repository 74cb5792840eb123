"""Another place that a run is kept in while it goes on; see `bench.harness.remote_runs` for one."""

from __future__ import annotations

from collections.abc import Iterable

from bench.harness.unit import Unit


class RunMirror:
    """What a run tells of its progress; this mirror keeps nothing."""

    def begin(self, *, parts: int) -> None:
        """A run, or a part of one, begins; brings what tells which experiment is there already.

        Args:
            parts: of the run; reports of other parts of as many stay, but for a run in one piece.
        """

    def bring(self, units: Iterable[Unit]) -> None:
        """The run may write: bring stored units into its folder, before it is seen which are there."""

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Units of others go."""

    def keep(self, unit: Unit, *, anew: bool) -> None:
        """A unit is in the run's folder.

        Args:
            unit: which.
            anew: it was computed just now.
        """

    def keep_rest(self) -> None:
        """Everything else that was written since `begin` is complete."""


NOWHERE = RunMirror()
