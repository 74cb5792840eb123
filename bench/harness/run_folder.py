"""The folder of a run."""

from __future__ import annotations

from pathlib import Path

from bench.errors import DataError
from bench.harness.unit_files import FOLDER


def prepare_run_folder(run: Path) -> None:
    """Make the folder of a run, if it is not there.

    Raises:
        DataError: it holds something that is no run.
    """
    if run.exists() and any(run.iterdir()) and not (run / FOLDER).is_dir():
        do = "give another folder with --out, or remove what is in it"
        raise DataError(run, wanted="an empty folder or an older run", came="a folder with other files", do=do)
    (run / FOLDER).mkdir(parents=True, exist_ok=True)
