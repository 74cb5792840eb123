"""From options to objects: data set, method, protocol, executor, cache; and data that are rendered first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from bench.cli.console import detail, note, progress_bar
from bench.cli.interrupts import interruptible
from bench.errors import DataError, UsageError
from bench.evaluation import Protocol, load_protocol
from bench.execution import ProcessExecutor, TaskExecutor, usable_cores
from bench.harness.cache import CacheFolder, default_folder
from bench.harness.cluster import ClusterExecutor, WorkerRequirements, scheduler_address
from bench.methods import Scorable
from bench.plain_yaml import parse_yaml
from bench.recordings import DatasetCard, load_card

Built = TypeVar("Built")

LONGEST = 1000  # characters of one setting


@dataclass(frozen=True, slots=True, kw_only=True)
class Computing:
    """Options of commands that score.

    Attributes:
        workers: processes, as they were asked for; None for one per core.
        cache: folder of cached steps; None for the usual one.
        no_cache: keep nothing.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.
    """

    workers: int | None = None
    cache: Path | None = None
    no_cache: bool = False
    scheduler: str | None = None

    def executor(self, card: DatasetCard, method: Scorable, *, reads: Sequence[Path] = ()) -> TaskExecutor:
        """Return the executor that computes the units.

        Args:
            card: the data set, which exists.
            method: to be scored.
            reads: files and folders that the method reads beside the data set.

        Raises:
            UsageError: options that contradict each other, or a cluster that cannot compute for this run.
            DataError: no such cluster.
        """
        if self.scheduler is None:
            return worker_processes(self.workers)
        if self.workers is not None:
            raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
        local = card.root if card.remote_root is None else None
        data = [path for path in (local, card.annotations) if path is not None and path.exists()]
        requirements = WorkerRequirements.of(method, reads=(*data, *reads), cache=self.cache_folder)
        return ClusterExecutor.connect(scheduler_address(self.scheduler), requirements)

    @property
    def cache_folder(self) -> CacheFolder | None:
        """Folder of cached steps; None to store none."""
        return None if self.no_cache else CacheFolder(folder=self.cache or default_folder())


def worker_processes(workers: int | None) -> TaskExecutor:
    """Processes of this machine beside that of the command, so that no method ends it without a word.

    Args:
        workers: how many; None for one per core.
    """
    return ProcessExecutor(workers=workers or usable_cores())


def chosen(
    dataset: str,
    build: Callable[[str, Mapping[str, object]], Built],
    *,
    method: str,
    settings: Sequence[str] | None,
    protocol: str,
) -> tuple[DatasetCard, Built, Protocol]:
    """Load what options name: data set, method, protocol.

    Args:
        dataset: card, or its name.
        build: `build_method`, or `build_scorable` to take also what sees the truth and is no method.
        method: name, or "module:Class".
        settings: of the method, "name=value".
        protocol: name or file.

    Raises:
        UnknownNameError, UsageError, DataError: one of them is not there or cannot be used.
    """
    return load_card(dataset), build(method, parse_settings(settings or [])), load_protocol(protocol)


def parse_settings(pairs: Sequence[str], *, option: str = "--set") -> dict[str, Any]:
    """Parse assignments: `weights.anti_parallel=0` becomes `{"weights": {"anti_parallel": 0}}`.

    Raises:
        UsageError: no `=`, a value that is no YAML, or a name that is both a value and a group.
    """
    parsed: dict[str, Any] = {}
    for pair in pairs:
        if len(pair) > LONGEST:
            raise UsageError(f"{option}: expected at most {LONGEST} characters, got {len(pair)}")
        name, equals, text = pair.partition("=")
        if not (equals and name):
            raise UsageError(f"{option}: expected NAME=VALUE, got {pair!r}")
        try:
            value = parse_yaml(text, file=f"{option} {name}")
        except DataError as error:
            raise UsageError(f"{option} {name}: expected a YAML value, got {text!r}") from error
        group = parsed
        *parents, leaf = name.split(".")
        for parent in parents:
            group = group.setdefault(parent, {})
            if not isinstance(group, dict):
                raise UsageError(f"{option} {name}: {parent!r} already has the value {group!r}")
        group[leaf] = _number(value)
    return parsed


def split_method(text: str) -> tuple[str, list[str]]:
    """Name and settings of a method on one line: `spherical:flow=dis:cell_size_px=4`.

    Raises:
        UsageError: words behind a setting that are none.
    """
    words = text.split(":")
    settings = [word for word in words if "=" in word]
    method = words[: len(words) - len(settings)]  # "module:Class" has a colon of its own
    if any("=" in word for word in method):
        raise UsageError(f"--methods: expected METHOD:NAME=VALUE:NAME=VALUE, got {text!r}")
    return ":".join(method), settings


def _number(value: object) -> object:
    """YAML 1.1 reads `6e-4` as text; users mean the number."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def render(scenario: Path, out: Path, *, workers: int | None = None) -> None:
    """Render a scenario with a progress bar and say where."""
    from bench.synthesis import synthesize  # a second, and data that are there already need none of it

    left = f"the recordings that are done are in {out}, and the same command goes on from there"
    with interruptible(left), progress_bar(f"rendering {scenario.stem}", "recordings") as report:
        folders = synthesize(scenario, out, workers=workers, progress=report)
    note(f"{len(folders)} recordings in {out}")


def render_if_synthetic(card: DatasetCard) -> None:
    """Render what a card's scenario asks for and is not there yet."""
    detail(f"card {card.file}, root {card.content.root}")
    if card.scenario is not None and card.remote_root is None:
        render(card.scenario, card.root)
