"""Folders of runs that a command is given: paths, or addresses on object storage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import UsageError
from bench.harness.remote_runs import NOWHERE, RemoteRun, RunMirror, downloaded_run
from bench.recordings.object_storage import RemoteUrl, parse_location


@dataclass(frozen=True, slots=True, kw_only=True)
class Destination:
    """Where a run is written.

    Attributes:
        folder: on this machine.
        mirror: stores it at an address too, where one was given.
        url: that address.
    """

    folder: Path
    mirror: RunMirror = NOWHERE
    url: RemoteUrl | None = None

    def __str__(self) -> str:
        return str(self.url or self.folder)

    def display_path(self, file: Path) -> str:
        """A file in it as the user is shown it: its path, or its address."""
        if self.url is None or not file.is_relative_to(self.folder):
            return str(file)
        return f"{self.url}/{file.relative_to(self.folder).as_posix()}"


def destination(place: str | None, otherwise: Path) -> Destination:
    """Where a run goes.

    Args:
        place: path or address; None for none given.
        otherwise: folder where none is given.

    Raises:
        UsageError: an address that cannot be used.
    """
    parsed = otherwise if place is None else parsed_location(place)
    if isinstance(parsed, Path):
        return Destination(folder=parsed)
    remote = RemoteRun(url=parsed)
    return Destination(folder=remote.folder, mirror=remote, url=parsed)


def finished_run(place: str) -> Path:
    """A stored run to read: its folder, or a copy of one at an address.

    Raises:
        UsageError: an address that cannot be used.
        DataError: nothing is there, or it cannot be read.
    """
    parsed = parsed_location(place)
    return parsed if isinstance(parsed, Path) else downloaded_run(parsed)


def parts_of_run(run: Destination, parts: Sequence[str]) -> list[Path]:
    """Folders that hold the parts of a run, with what is at addresses downloaded.

    Args:
        run: where it is merged; holds the parts where no others are given.
        parts: paths and addresses.

    Raises:
        UsageError: an address that cannot be used.
        DataError: it cannot be read, or `run` not be written.
    """
    if isinstance(run.mirror, RemoteRun):
        run.mirror.download_parts(write=True)
    folders = []
    for place in parts:
        parsed = parsed_location(place)
        if isinstance(parsed, Path):
            folders.append(parsed)
            continue
        remote = RemoteRun(url=parsed)
        if parsed != run.url:
            remote.download_parts(write=False)
        folders.append(remote.folder)
    return folders or [run.folder]


def parsed_location(place: str) -> Path | RemoteUrl:
    """A folder by path or address.

    Raises:
        UsageError: neither.
    """
    if not place:
        raise UsageError("expected a folder, got an empty name")
    return parse_location(place)
