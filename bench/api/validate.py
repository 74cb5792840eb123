"""Everything that looks wrong in a data set."""

from __future__ import annotations

from pathlib import Path

from bench.api.datasets import rendered_card
from bench.harness.stages import Progress
from bench.recordings import DatasetCard, open_dataset
from bench.validation import Depth, ValidationReport, validate_dataset


def validate(
    dataset: str | Path | DatasetCard, *, split: str | None = None, deep: bool = False, progress: Progress | None = None
) -> ValidationReport:
    """Validate a data set, as `fisheye-bench validate` does; what a scenario has rendered is validated as it is.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set; None for all of it.
        deep: read every image and sweep, not a sample.
        progress: called with the recordings done, fractions allowed, and their number.

    Returns:
        What looks wrong: `findings`, their numbers `errors` and `warnings`, and `recordings`, which say what was read.

    Raises:
        UnknownNameError: no data set or split of this name.
        DataError: the card cannot be used; what is wrong with a recording is a finding.
    """
    card = rendered_card(dataset, split, as_it_is=True)
    depth = Depth.DEEP if deep else Depth.SAMPLED
    return validate_dataset(card.name, open_dataset(card, split), depth=depth, progress=progress)
