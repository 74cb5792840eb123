"""The manifest of a run: what it is of and what made it, and the one answer to what differs between two runs."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

import bench
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.code_state import package_commit
from bench.harness.digests import code_digest, short_digest
from bench.harness.digests.content import METRIC_CODE
from bench.harness.method_of_run import MethodOfRun, flat_settings
from bench.harness.provenance import combined_digest, library_versions
from bench.plain_text import listed
from bench.recordings.checked_json import read_checked, write_checked

MANIFEST = "manifest.json"
RECORDING_DIGEST_CHARS = 16  # characters of the digest of a recording's data that say whether it changed
LISTED = 4  # recordings that a sentence lists
PREDICTIONS_DIGEST = "digest"  # a setting of predictions from disk: their content, which is data


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DatasetOfRun(_Part):
    """The data of a run.

    Attributes:
        name: of the data set.
        card: path or name of its card, as `DatasetCard.address`; it may be named in several ways.
        split: of it; None for all.
        input_errors: injected into what the method is told, by name; empty for none.
        data: digest of all recordings' data; None until they were opened.
        recordings: the first characters of the digest of each recording's data, by name.
    """

    name: str
    card: str
    split: str | None
    input_errors: dict[str, float] = Field(default_factory=dict)
    data: str | None = None
    recordings: dict[str, str] = Field(default_factory=dict)


class CodeOfRun(_Part):
    """The code of a run.

    Attributes:
        version: of the package.
        commit: of the checkout that ran, "+" behind it where files were changed, or that pip installed from; None where
            neither is known.
        python: version of the interpreter.
        libraries: versions of those that decide metrics.
        digest: of this package's code that decides metrics; None where nobody took it.
    """

    version: str
    commit: str | None
    python: str
    libraries: dict[str, str]
    digest: str | None = None

    @classmethod
    def here(cls) -> CodeOfRun:
        """The code of this process."""
        return cls(
            version=bench.__version__,
            commit=package_commit(),
            python=platform.python_version(),
            libraries=dict(library_versions()),
            digest=code_digest(METRIC_CODE),
        )

    @property
    def text(self) -> str:
        """The commit, or the version where it is unknown."""
        if self.commit is None:
            return f"version {self.version} of an unknown commit"
        dirty = " with changed files" if self.commit.endswith("+") else ""
        return f"commit {short_digest(self.commit).rstrip('+')}{dirty}"


class Manifest(_Part):
    """Everything that decides the results of a run.

    Attributes:
        dataset: the data.
        method: that is scored, with its settings and the digest of its code and files.
        protocol: the rules.
        code: of this package, and its libraries.
        reference: digest of what the reference alone decides; None until the run is finished.
        sums: digest of the table of sums, so that a baseline is noticed to be damaged; None until the run is finished.
    """

    dataset: DatasetOfRun
    method: MethodOfRun
    protocol: ProtocolOfRun
    code: CodeOfRun
    reference: str | None = None
    sums: str | None = None

    @property
    def title(self) -> str:
        """For example "spherical on demo by paper-v1"."""
        return f"{self.method.name} on {self.dataset.name} by {self.protocol.name}"

    def as_read(self) -> Manifest:
        """The manifest as it reads from a file: lists, not tuples."""
        return Manifest.model_validate_json(self.model_dump_json())

    def with_data(self, digests: Mapping[str, str]) -> Manifest:
        """The manifest with the digests of recordings' data, by name."""
        recordings = {name: digest[:RECORDING_DIGEST_CHARS] for name, digest in sorted(digests.items())}
        data = {"data": combined_digest([*digests.values()]), "recordings": recordings}
        return self.model_copy(update={"dataset": self.dataset.model_copy(update=data)})


class Aspect(StrEnum):
    """A part of the manifest in which two runs may differ, as sentences call it."""

    DATASET = "data set"
    SPLIT = "split"
    INPUT_ERRORS = "input errors"
    METHOD = "method"
    SETTINGS = "settings"
    PROTOCOL = "protocol"
    CODE = "code"
    METHOD_CODE = "code of the method"
    DATA = "data"
    REFERENCE = "reference"


_INCOMPARABLE = {Aspect.DATASET, Aspect.SPLIT, Aspect.PROTOCOL}
_OF_THE_REQUEST = {*_INCOMPARABLE, Aspect.INPUT_ERRORS, Aspect.METHOD, Aspect.SETTINGS}
# The text says what it is of.
_NAMED_BY_ITSELF = {
    Aspect.SETTINGS,
    Aspect.INPUT_ERRORS,
    Aspect.CODE,
    Aspect.METHOD_CODE,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something in which two runs differ.

    Attributes:
        aspect: part of the manifest.
        before: of the first run, in words.
        after: of the second.
        lead: words before these.
        name: of the setting, input error or library; "" where there is only one such thing.
    """

    aspect: Aspect
    before: str
    after: str
    lead: str = ""
    name: str = ""

    @property
    def text(self) -> str:
        """The two values, for example "'everything', was 'nothing'" or "flow = dis, was farneback"."""
        return f"{self.lead}{self.after}, was {self.before}"

    def __str__(self) -> str:
        return self.text if self.aspect in _NAMED_BY_ITSELF else f"{self.aspect} {self.text}"

    @property
    def comparable(self) -> bool:
        """True if results still compare; of another reference they do on the images where both agree."""
        return self.aspect not in _INCOMPARABLE

    @property
    def of_the_request(self) -> bool:
        """True if another run was asked for; code and data may change from one start of a run to the next."""
        return self.aspect in _OF_THE_REQUEST and self.name != PREDICTIONS_DIGEST


def differences(before: Manifest, after: Manifest) -> tuple[Difference, ...]:
    """List what differs between two runs, in the order of `Aspect`; what one of them does not know yet differs in none.

    Args:
        before: the first run.
        after: the second run, of which sentences say "..., was ...".
    """
    return tuple(_differences(before, after))


def _differences(before: Manifest, after: Manifest) -> Iterator[Difference]:
    was, now, one, two = before.dataset, after.dataset, before.method, after.method
    yield from _one(Aspect.DATASET, repr(was.name), repr(now.name))
    yield from _one(Aspect.SPLIT, _or_none(was.split), _or_none(now.split))
    yield from _each(Aspect.INPUT_ERRORS, was.input_errors, now.input_errors)
    yield from _one(Aspect.METHOD, repr(one.name), repr(two.name))
    if one.name == two.name:
        yield from _each(Aspect.SETTINGS, all_settings(one), all_settings(two))
    yield from _one(Aspect.PROTOCOL, protocol_text(before.protocol), protocol_text(after.protocol))
    yield from _code(before.code, after.code)
    if one.name == two.name:
        lead = "the method's own code, libraries or files: "
        yield from _digest(Aspect.METHOD_CODE, one.code_digest, two.code_digest, lead=lead)
    recordings = "".join(f"{text}; " for text in _changed_recordings(was.recordings, now.recordings))
    yield from _digest(Aspect.DATA, was.data, now.data, lead=recordings)
    yield from _digest(Aspect.REFERENCE, before.reference, after.reference)


def all_settings(method: MethodOfRun) -> dict[str, object]:
    """The settings of a method by dotted name: those that it reports, and those asked for that it does not report."""
    return flat_settings(method.asked) | flat_settings(method.settings)


def protocol_text(protocol: ProtocolOfRun) -> str:
    """For example "paper-v1 version 1 (075012207d4a)"."""
    return f"{protocol.name} version {protocol.version} ({short_digest(protocol.digest)})"


def write_manifest(run: Path, manifest: Manifest) -> None:
    """Write `manifest.json`."""
    write_checked(run / MANIFEST, manifest)


def read_manifest(run: Path) -> Manifest | None:
    """Read `manifest.json`; None where there is none.

    Raises:
        DataError: damaged.
    """
    file = run / MANIFEST
    return read_checked(Manifest, file, expected="the manifest of a run") if file.exists() else None


def _one(aspect: Aspect, before: str, after: str) -> Iterator[Difference]:
    if before != after:
        yield Difference(aspect=aspect, before=before, after=after)


def _each(
    aspect: Aspect,
    before: Mapping[str, object],
    after: Mapping[str, object],
    *,
    between: str = " = ",
    absent: object = None,
) -> Iterator[Difference]:
    """Compare value by value; `between` stands between name and value, `absent` for a value that is not there."""
    for name in sorted(before.keys() | after.keys()):
        was, now = before.get(name, absent), after.get(name, absent)
        if was != now:
            yield Difference(aspect=aspect, before=str(was), after=str(now), lead=f"{name}{between}", name=name)


def _digest(aspect: Aspect, before: str | None, after: str | None, *, lead: str = "") -> Iterator[Difference]:
    """Compare digests that both runs know."""
    if before is not None and after is not None and before != after:
        was, now = short_digest(before), short_digest(after)
        yield Difference(aspect=aspect, before=was, after=now, lead=f"{lead}digest ")


def _code(was: CodeOfRun, now: CodeOfRun) -> Iterator[Difference]:
    if (was.version, was.commit) != (now.version, now.commit):
        yield from _one(Aspect.CODE, was.text, now.text)
    elif was.libraries == now.libraries:
        yield from _digest(Aspect.CODE, was.digest, now.digest, lead=f"other code of {now.text}: ")
    versions = [{"Python": code.python, **code.libraries} for code in (was, now)]
    yield from _each(Aspect.CODE, *versions, between=" ", absent="not loaded")


def _changed_recordings(was: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Name the recordings with other data; nothing where a side does not say."""
    if not (was and now):
        return
    common = was.keys() & now.keys()
    for kind, names, count in (
        ("changed", {name for name in common if was[name] != now[name]}, len(common)),
        ("new", now.keys() - was.keys(), len(now)),
        ("missing", was.keys() - now.keys(), len(was)),
    ):
        if names:
            yield f"recordings {kind}: {listed([*map(repr, sorted(names))], LISTED)} ({len(names)} of {count})"


def _or_none(split: str | None) -> str:
    return "none" if split is None else repr(split)
