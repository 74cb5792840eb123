"""What an audit reads: recordings as the benchmark reads them, the same with exact calibration, and their scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bench.errors import UsageError
from bench.recordings import DatasetCard, RecordingHandle, open_dataset
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.scenario import RecordingSpec

EXACT = {"calibration": "exact"}
NO_SCENARIO = "the data set's card names no scenario, so there is no exact flow"


@dataclass(frozen=True, slots=True, kw_only=True)
class AuditSource:
    """One recording; it travels to other processes.

    Attributes:
        recorded: as the benchmark reads it.
        exact: the same with the true calibration; None without a scene.
        scenario: that the recording was rendered from; None where the card names none.
        spec: the recording in the scenario; None where it is not there.
    """

    recorded: RecordingHandle
    exact: RecordingHandle | None = None
    scenario: Scenario | None = None
    spec: RecordingSpec | None = None


def audit_sources(card: DatasetCard, *, split: str | None, recordings: int | None) -> tuple[AuditSource, ...]:
    """The recordings of an audit.

    Args:
        card: the data set.
        split: of it; None for all.
        recordings: how many, spread evenly over the split so that a few still show every kind of drive; None for all.

    Raises:
        DataError: the data set or its scenario cannot be read.
        UsageError: fewer than one recording asked for.
    """
    handles = _spread(open_dataset(card, split), recordings)
    if card.scenario is None:
        return tuple(AuditSource(recorded=handle) for handle in handles)
    scenario = read_scenario(card.scenario)
    specs = {spec.name: spec for spec in scenario.recordings}
    exact = {handle.name: handle for handle in open_dataset(_exact_card(card), split)}
    return tuple(
        AuditSource(recorded=handle, exact=exact[handle.name], scenario=scenario, spec=specs.get(handle.name))
        for handle in handles
    )


def _spread(handles: tuple[RecordingHandle, ...], expected: int | None) -> tuple[RecordingHandle, ...]:
    if expected is None or expected >= len(handles):
        return handles
    if expected < 1:
        raise UsageError(f"--recordings: expected at least 1, got {expected}")
    return tuple(handles[k * len(handles) // expected] for k in range(expected))


def _exact_card(card: DatasetCard) -> DatasetCard:
    options = {**card.content.options, **EXACT}
    return replace(card, content=card.content.model_copy(update={"options": options}))
