"""A run in one file, for others to list and to verify."""

from __future__ import annotations

from pathlib import Path

from bench.api.runs import Run, run_folder
from bench.exchange import bundle as bundles


def write_bundle(run: str | Path | Run, file: str | Path) -> Path:
    """Pack what decides a run's metrics into one file, as `fisheye-bench bundle` does.

    Args:
        run: stored, or its folder.
        file: for example "my.run.zip".

    Returns:
        The file.

    Raises:
        DataError: the run is missing or damaged.
        OutputError: the file cannot be written.
    """
    bundles.write_bundle(run_folder(run), Path(file))
    return Path(file)


def unpack_bundle(file: str | Path, folder: str | Path) -> Run:
    """Unpack a run that somebody sent, checked, as `fisheye-bench unbundle` does; `bench.verify` counts it again.

    Args:
        file: written by `write_bundle`.
        folder: of the run, new or empty.

    Raises:
        DataError: not a bundle, a damaged one, or a folder that holds something.
    """
    return Run(stored=bundles.unpack_bundle(Path(file), Path(folder)))
