"""What one part of a run leaves for the others: `shards/<i>-of-<N>.json`. A run in one piece is part 1 of 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from bench.errors import DataError, UsageError
from bench.harness.manifest import Manifest
from bench.harness.method_stamp import MethodStamp
from bench.harness.provenance import Provenance
from bench.harness.unit import Unit
from bench.recordings.sealed_json import read_sealed, write_sealed

FOLDER = "shards"
SCHEMA_VERSION = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Shard:
    """A part of a run: every `count`-th unit, from the `number`-th on.

    Attributes:
        number: from 1.
        count: of parts.

    Raises:
        UsageError: a number outside of 1 to `count`.
    """

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise UsageError(f"--shard: expected I/N with I from 1 to N, got {self}")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @property
    def file(self) -> str:
        """Name of its report."""
        return f"{self.number:04d}-of-{self.count:04d}.json"

    def part(self, units: Sequence[Unit]) -> list[Unit]:
        """Its own among all units of a run."""
        return list(units[self.number - 1 :: self.count])

    @classmethod
    def parse(cls, text: str) -> Shard:
        """From "2/8".

        Raises:
            UsageError: anything else.
        """
        number, _, count = text.partition("/")
        if not (number.isascii() and number.isdecimal() and count.isascii() and count.isdecimal()):
            raise UsageError(f"--shard: expected I/N, for example 2/8, got {text!r}")
        return cls(number=int(number), count=int(count))


WHOLE = Shard()


class RunStamp(BaseModel):
    """What all parts of a run share.

    Attributes:
        dataset: name of the data set.
        card: file of its card, as it was named; it may be named in several ways.
        data: digest of calibration, ego-motion and annotations of all recordings, and of names and sizes of images and
            sweeps; the content of these is part of each unit's key.
        split: of it; None for all.
        method: that is scored, with the identity of its code and files.
        code: digest of this package's code, of Python's version and of the libraries that decide metrics.
        protocol_digest: of the rules.
        caveats: of the data set's card.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    dataset: str
    card: str
    data: str
    split: str | None
    method: MethodStamp
    code: str
    protocol_digest: str
    caveats: str

    def difference(self, other: RunStamp) -> str:
        """What another part is of that this one is not, in words; empty where both are of one run."""
        words = {
            "dataset": "another data set",
            "split": "another split",
            "data": "other data: recordings, calibration, ego-motion or annotations",
            "protocol_digest": "another protocol",
            "code": "other code of fisheye-bench, another Python or other libraries",
            "caveats": "other caveats of the data set",
        }
        found = [told for name, told in words.items() if getattr(self, name) != getattr(other, name)]
        one, two = self.method, other.method
        if (one.name, one.settings) != (two.name, two.settings):
            found.append(f"another method or other settings ({two.name})")
        elif one != two:
            found.append(f"other code, libraries or files of the method {two.name!r}")
        return ", ".join(found)


class ShardedUnit(BaseModel):
    """A unit of a part, and the key of its result; None where it could not be scored."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    recording: str
    camera: str
    start: int
    stop: int
    key: str | None

    @property
    def unit(self) -> Unit:
        """The unit."""
        return Unit(recording=self.recording, camera=self.camera, start=self.start, stop=self.stop)


class ShardReport(BaseModel):
    """A part that is done.

    Attributes:
        schema_version: of this file.
        stamp: of the run.
        manifest: of the run.
        units_of_run: how many units all parts have together.
        units: of this part, in the order of the run.
        vehicle_outline_m: the ego vehicle from above.
        recording_failures: one line per recording that cannot be used; the same in all parts.
        unit_failures: one line per unit of this part that could not be scored.
        provenance: of this part.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int
    stamp: RunStamp
    manifest: Manifest
    units_of_run: int
    units: tuple[ShardedUnit, ...]
    vehicle_outline_m: tuple[tuple[float, float], ...]
    recording_failures: tuple[str, ...]
    unit_failures: tuple[str, ...]
    provenance: Provenance


def write_shard(run: Path, shard: Shard, report: ShardReport) -> None:
    """Store the report of a part."""
    write_sealed(run / FOLDER / shard.file, report)


def remove_shards(run: Path, *, but_of: int | None = None) -> None:
    """Remove reports.

    Args:
        run: folder.
        but_of: keep those of runs in so many parts; None to remove all.
    """
    for file in (run / FOLDER).glob("*.json"):
        if but_of is None or not file.name.endswith(f"-of-{but_of:04d}.json"):
            file.unlink(missing_ok=True)


def read_shards(runs: Sequence[Path]) -> list[tuple[Path, ShardReport]]:
    """The reports of all parts of a run with the folder of each, in the order of their numbers.

    Args:
        runs: folders that hold them, one or many.

    Raises:
        DataError: none, a part is missing or there twice, or they are of different runs.
    """
    files: dict[str, Path] = {}
    for run in runs:
        for file in sorted((run / FOLDER).glob("*-of-*.json")):
            if file.name in files:
                do = "leave out one of the two folders"
                raise DataError(file, expected="each part once", got=f"the same part in {files[file.name]}", do=do)
            files[file.name] = file
    if not files:
        do = "score with `run --shard 1/N` to `N/N` first"
        raise DataError(runs[0], expected="parts of a run, in shards/", got="none", do=do)
    counts = {name.rpartition("-of-")[2] for name in files}
    if len(counts) > 1:
        got, do = f"parts of different cuts: {', '.join(sorted(files))}", "give folders of parts I/N of the same N"
        raise DataError(runs[0], expected="parts of one run", got=got, do=do)
    count = int(counts.pop().removesuffix(".json"))
    expected = [Shard(number=number, count=count) for number in range(1, count + 1)]
    missing = [str(shard) for shard in expected if shard.file not in files]
    if missing:
        do = "score the missing ones with --shard; parts that are done are kept"
        raise DataError(runs[0], expected=f"{count} parts", got=f"none of {', '.join(missing)}", do=do)
    found = [(files[shard.file].parent.parent, read_shard(files[shard.file])) for shard in expected]
    first = found[0][1]
    for shard, (folder, report) in zip(expected, found, strict=True):
        difference = first.stamp.difference(report.stamp)
        if not difference and report.units_of_run != first.units_of_run:
            difference = f"{report.units_of_run} units in all parts, not {first.units_of_run}"
        if difference:
            got, do = f"part {shard} with {difference}", "score all parts again with the same of everything"
            raise DataError(folder, expected=f"parts of one run, as part {expected[0]}", got=got, do=do)
    return found


def read_shard(file: Path) -> ShardReport:
    """Read the report of a part.

    Raises:
        DataError: not one.
    """
    return read_sealed(ShardReport, file, expected="the report of a part")
