"""The manifest of a run: what it is of and what made it, and the one answer to what differs between two runs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

import bench
from bench.atomic import write_text
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.digests import ANSWER_CODE, COUNT_CODE, code_digest, digest_of, library_versions, short_digest
from bench.harness.method_of_run import MethodOfRun, commit_of
from bench.methods.settings import flat_settings
from bench.plain_text import listed
from bench.recordings.validation import read_json

MANIFEST = "manifest.json"
ANSWERS_MANIFEST = "run.json"
RECORDING_DIGEST_CHARS = 16  # characters of the digest of a recording's content that say whether it changed
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
        recordings: the first characters of the digest of each recording's content, by name.
    """

    name: str
    card: str
    split: str | None
    input_errors: dict[str, float] = Field(default_factory=dict)
    recordings: dict[str, str] = Field(default_factory=dict)

    @property
    def same_data(self) -> tuple[str, ...]:
        """A sentence for recordings that hold the same data, which intervals take as independent."""
        names: dict[str, list[str]] = {}
        for name, digest in self.recordings.items():
            names.setdefault(digest, []).append(name)
        return tuple(
            f"Recordings {', '.join(map(repr, same))} hold the same data; intervals take them as independent."
            for same in names.values()
            if len(same) > 1
        )


class CodeOfRun(_Part):
    """The code of a run.

    Attributes:
        version: of the package.
        commit: of the checkout that ran, "+" behind it where files were changed, or that pip installed from; None where
            neither is known. It decides nothing.
        libraries: versions of the interpreter and of the libraries that decide metrics.
        answers: digest of this package's code that decides answers.
        counts: digest of that which decides references and counts.
    """

    version: str
    commit: str | None
    libraries: dict[str, str]
    answers: str
    counts: str

    @classmethod
    def here(cls) -> CodeOfRun:
        """The code of this process."""
        return cls(
            version=bench.__version__,
            commit=package_commit(),
            libraries=dict(library_versions()),
            answers=code_digest(ANSWER_CODE),
            counts=code_digest(COUNT_CODE),
        )

    @property
    def text(self) -> str:
        """The commit, or the version where it is unknown."""
        if self.commit is None:
            return f"version {self.version} of an unknown commit"
        dirty = " with changed files" if self.commit.endswith("+") else ""
        return f"commit {short_digest(self.commit).rstrip('+')}{dirty}"


class AnswersManifest(_Part):
    """Everything that decides the answers of a run, in `run.json`.

    Attributes:
        dataset: the data.
        method: that is asked, with its settings and the digest of its code and files.
        code: of this package, and its libraries.
    """

    dataset: DatasetOfRun
    method: MethodOfRun
    code: CodeOfRun

    def by(self, protocol: Protocol) -> Manifest:
        """The manifest of the results by a protocol."""
        rules = ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest)
        return Manifest(dataset=self.dataset, method=self.method, code=self.code, protocol=rules)


class Manifest(AnswersManifest):
    """Everything that decides the results of a run by one protocol, in `manifest.json`.

    Attributes:
        protocol: the rules.
        reference: digest of what the reference alone decides; None until the run is finished.
    """

    protocol: ProtocolOfRun
    reference: str | None = None

    @property
    def title(self) -> str:
        """For example "spherical on demo by paper-v1"."""
        return f"{self.method.name} on {self.dataset.name} by {self.protocol.name}"


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
# The text says what it is of.
_NAMED_BY_ITSELF = {Aspect.SETTINGS, Aspect.INPUT_ERRORS, Aspect.CODE, Aspect.METHOD_CODE}


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something in which two runs differ.

    Attributes:
        aspect: part of the manifest.
        before: of the first run, in words.
        after: of the second.
        lead: words before these.
        name: of the setting, input error or library; "" where there is only one such thing.
        decides: results may differ by it; False for the commit alone.
    """

    aspect: Aspect
    before: str
    after: str
    lead: str = ""
    name: str = ""
    decides: bool = True

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


def differences(before: AnswersManifest, after: AnswersManifest) -> tuple[Difference, ...]:
    """List what differs between two runs, in the order of `Aspect`; what one of them does not know yet differs in none.

    Args:
        before: the first run.
        after: the second run, of which sentences say "..., was ...".
    """
    return tuple(_differences(before, after))


def _differences(before: AnswersManifest, after: AnswersManifest) -> Iterator[Difference]:
    was, now, one, two = before.dataset, after.dataset, before.method, after.method
    yield from _one(Aspect.DATASET, repr(was.name), repr(now.name))
    yield from _one(Aspect.SPLIT, _or_none(was.split), _or_none(now.split))
    yield from _each(Aspect.INPUT_ERRORS, was.input_errors, now.input_errors)
    yield from _one(Aspect.METHOD, repr(one.name), repr(two.name))
    if one.name == two.name:
        yield from _each(Aspect.SETTINGS, all_settings(one), all_settings(two))
    if isinstance(before, Manifest) and isinstance(after, Manifest):
        yield from _one(Aspect.PROTOCOL, protocol_text(before.protocol), protocol_text(after.protocol))
    counted = isinstance(before, Manifest) and isinstance(after, Manifest)
    yield from _code(before.code, after.code, counted=counted)
    if one.name == two.name:
        lead = "the method's own code, or files: "
        yield from _digest(Aspect.METHOD_CODE, one.code_digest, two.code_digest, lead=lead)
    if changes := [*_changed_recordings(was.recordings, now.recordings)]:
        digests = [digest_of(data.recordings) for data in (was, now)]
        yield from _digest(Aspect.DATA, *digests, lead="".join(f"{text}; " for text in changes))
    if isinstance(before, Manifest) and isinstance(after, Manifest):
        yield from _digest(Aspect.REFERENCE, before.reference, after.reference)


def all_settings(method: MethodOfRun) -> dict[str, object]:
    """The settings of a method by dotted name: those that it reports, and those asked for that it does not report."""
    return flat_settings(method.asked) | flat_settings(method.settings)


def protocol_text(protocol: ProtocolOfRun) -> str:
    """For example "paper-v1 version 1 (075012207d4a)"."""
    return f"{protocol.name} version {protocol.version} ({short_digest(protocol.digest)})"


def write_manifest(file: Path, manifest: AnswersManifest) -> None:
    """Write a manifest."""
    write_text(file, manifest.model_dump_json(indent=1) + "\n")


def read_manifest(folder: Path) -> Manifest | None:
    """Read the manifest of results, or of a baseline; None where there is none.

    Raises:
        DataError: damaged.
    """
    file = folder / MANIFEST
    return read_json(Manifest, file) if file.exists() else None


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


def _code(was: CodeOfRun, now: CodeOfRun, *, counted: bool) -> Iterator[Difference]:
    """Compare the code of answers, and where both are of results also that of counts."""
    digests = [digest_of(code.answers, code.counts if counted else "") for code in (was, now)]
    if (was.version, was.commit) != (now.version, now.commit):
        decides = digests[0] != digests[1]
        yield Difference(aspect=Aspect.CODE, before=was.text, after=now.text, decides=decides)
    else:
        yield from _digest(Aspect.CODE, *digests, lead=f"other code of {now.text}: ")
    yield from _each(Aspect.CODE, was.libraries, now.libraries, between=" ", absent="not loaded")


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


def package_commit() -> str | None:
    """Commit of the checkout that the package runs from, "+" behind it where files were changed; or of the repository
    that pip installed it from; None where neither is known."""
    package = Path(bench.__file__).resolve()
    commit = commit_of(package)
    if commit is not None:
        return commit
    try:
        installed = distribution("fisheye-bench")
    except PackageNotFoundError:
        return None
    if Path(str(installed.locate_file("bench/__init__.py"))).resolve() != package:
        return None  # what runs is another copy
    told = installed.read_text("direct_url.json")  # PEP 610
    commit = json.loads(told).get("vcs_info", {}).get("commit_id") if told else None
    return str(commit) if commit else None
