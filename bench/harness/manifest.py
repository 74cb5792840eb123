"""The manifest of a run: what it is of and what made it, and the one answer to what differs between two runs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from site import getsitepackages, getusersitepackages
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

import bench
from bench.atomic import write_text
from bench.errors import UsageError
from bench.evaluation.protocol import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.digests import (
    ANSWER_CODE,
    COUNT_CODE,
    PACKAGE,
    code_digest,
    digest_file,
    digest_of,
    library_versions,
    short_digest,
)
from bench.harness.exact import ORACLES, build_scorable, scorable_methods
from bench.methods import METHODS, Scorable
from bench.methods.contract import refuse_unfit
from bench.methods.settings import flat_settings
from bench.plain_text import listed
from bench.recordings.validation import read_json

MANIFEST = "manifest.json"
ANSWERS_MANIFEST = "run.json"
RECORDING_DIGEST_CHARS = 16  # characters of the digest of a recording's content that say whether it changed
DESCRIBE = ("describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+")
LISTED = 4  # recordings that a sentence lists
PREDICTIONS_DIGEST = "digest"  # a setting of predictions from disk: their content, which is data
UNIDENTIFIED = "unidentified"


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


class MethodOfRun(_Part):
    """Method that made the metrics; what a stored file names is never imported from here.

    Attributes:
        name: its own.
        settings: every parameter, as the method reports them.
        asked: parameters that the user named, as they were asked for.
        place: "module:Class" of its class; recorded only, never imported from here.
        history: images that it needs before the one that it segments.
        code_digest: of the package that holds its class, or of the modules beside it, and of the files that it reads;
            `UNIDENTIFIED` where no file holds the class, as in a notebook's cell: such a run is computed anew.
    """

    name: str
    settings: dict[str, object]
    asked: dict[str, object] = Field(default_factory=dict)
    place: str
    history: int
    code_digest: str

    @classmethod
    def of(cls, method: Scorable, *, asked: Mapping[str, object] = MappingProxyType({})) -> MethodOfRun:
        """Record a method in this process.

        Raises:
            UsageError: `files` or `settings()` are not what the contract asks for.
        """
        refuse_unfit(method)
        kind = type(method)
        return cls(
            name=method.name,
            settings=json.loads(json.dumps(method.settings(), default=str)),
            asked=json.loads(json.dumps(dict(asked), default=str)),
            place=f"{kind.__module__}:{kind.__qualname__}",
            history=method.history,
            code_digest=method_digest(method),
        )

    @property
    def is_identified(self) -> bool:
        """True if a file holds its code, so that a change is seen."""
        return self.code_digest != UNIDENTIFIED

    @property
    def is_own(self) -> bool:
        """It is of this package."""
        return self.place.startswith("bench.")

    @property
    def called(self) -> str:
        """Value of `--method` that selects it."""
        return self.name if self.place == scorable_methods().get(self.name) else self.place

    def options(self) -> list[str]:
        """The options of a command that ask for it: `--method`, and `--set` for each setting that is not its default.

        Of a method that is not of this package the defaults are unknown, since nothing that a stored file names is
        imported; all of its settings are said.
        """
        words = ["--method", self.called]
        for name, value in self.changed_settings().items():
            words += ["--set", f"{name}={json.dumps(value)}"]
        return words

    def changed_settings(self) -> dict[str, object]:
        """The settings that are not the method's defaults, by dotted name; all of them where these are unknown."""
        try:
            own = self.called in METHODS or self.called in ORACLES
            defaults = flat_settings(build_scorable(self.called).settings()) if own else {}
        except UsageError:  # its extra is not installed
            defaults = {}
        flat = flat_settings(self.settings)
        return {name: value for name, value in flat.items() if name not in defaults or defaults[name] != value}


class CodeOfRun(_Part):
    """The code of a run.

    Attributes:
        version: of the package.
        commit: of the checkout that ran, "+" behind it where files were changed; None of an installed package. It
            decides nothing.
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
    @cache
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


Values = Mapping[str, object]
_INCOMPARABLE = {Aspect.DATASET, Aspect.SPLIT, Aspect.PROTOCOL}
_NAMED = {Aspect.SETTINGS, Aspect.INPUT_ERRORS, Aspect.CODE, Aspect.METHOD_CODE}  # their text says what it is of


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Something in which two runs differ.

    Attributes:
        aspect: part of the manifest.
        before: of the first run, in words.
        after: of the second.
        lead: words before these.
        name: of the setting; "" for all else.
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
        return self.text if self.aspect in _NAMED else f"{self.aspect} {self.text}"

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
    found: list[Difference] = []

    def compare(aspect: Aspect, was: Any, now: Any, *, text: Callable[[Any], str] = str, **more: Any) -> None:
        if was != now:
            found.append(Difference(aspect=aspect, before=text(was), after=text(now), **more))

    def compare_digests(aspect: Aspect, was: str, now: str, lead: str = "") -> None:
        compare(aspect, was, now, text=short_digest, lead=f"{lead}digest ")

    def compare_named(aspect: Aspect, was: Values, now: Values, between: str = " = ", absent: object = None) -> None:
        for name in sorted((was.keys() | now.keys()) - {PREDICTIONS_DIGEST}):
            compare(aspect, was.get(name, absent), now.get(name, absent), lead=f"{name}{between}", name=name)

    data, new_data, code, new_code = before.dataset, after.dataset, before.code, after.code
    method, new_method = before.method, after.method
    counted = [run for run in (before, after) if isinstance(run, Manifest)]
    compare(Aspect.DATASET, data.name, new_data.name, text=repr)
    compare(Aspect.SPLIT, data.split, new_data.split, text=lambda split: "none" if split is None else repr(split))
    compare_named(Aspect.INPUT_ERRORS, data.input_errors, new_data.input_errors)
    compare(Aspect.METHOD, method.name, new_method.name, text=repr)
    if method.name == new_method.name:
        compare_named(Aspect.SETTINGS, all_settings(method), all_settings(new_method))
    if len(counted) == 2:
        compare(Aspect.PROTOCOL, counted[0].protocol, counted[1].protocol, text=protocol_text)
    digests = [digest_of(one.answers, one.counts if len(counted) == 2 else "") for one in (code, new_code)]
    if code.text == new_code.text:
        compare_digests(Aspect.CODE, digests[0], digests[1], f"other code of {code.text}: ")
    else:
        compare(Aspect.CODE, code.text, new_code.text, decides=digests[0] != digests[1])
    compare_named(Aspect.CODE, code.libraries, new_code.libraries, " ", "not loaded")
    if method.name == new_method.name:
        content = [str(one.settings.get(PREDICTIONS_DIGEST)) for one in (method, new_method)]
        compare_digests(Aspect.METHOD_CODE, content[0], content[1], "other predictions in the folder: ")
        compare_digests(
            Aspect.METHOD_CODE, method.code_digest, new_method.code_digest, "the method's own code, or files: "
        )
    if changed := "".join(f"{text}; " for text in _changed_recordings(data.recordings, new_data.recordings)):
        compare_digests(Aspect.DATA, digest_of(data.recordings), digest_of(new_data.recordings), changed)
    references = [run.reference for run in counted if run.reference is not None]
    if len(references) == 2:
        compare_digests(Aspect.REFERENCE, *references)
    return tuple(found)


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


def _changed_recordings(was: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Name the recordings with other data."""
    common = was.keys() & now.keys()
    for kind, names, count in (
        ("changed", {name for name in common if was[name] != now[name]}, len(common)),
        ("new", now.keys() - was.keys(), len(now)),
        ("missing", was.keys() - now.keys(), len(was)),
    ):
        if names:
            yield f"recordings {kind}: {listed([*map(repr, sorted(names))], LISTED)} ({len(names)} of {count})"


def package_commit() -> str | None:
    """Commit of the checkout that the package runs from, "+" behind it where files were changed; None elsewhere."""
    said = ""
    for words in (("ls-files", "--error-unmatch", "__init__.py"), DESCRIBE):
        command = ["git", "-C", str(PACKAGE), *words]
        try:
            said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30).stdout
        except (OSError, subprocess.SubprocessError):  # of no commit, or there is no git
            return None
    return said.strip()


def method_digest(method: Scorable) -> str:
    """Digest of a method's own code and of the files that it reads; `UNIDENTIFIED` where no file holds the code.

    Raises:
        UsageError: a file that it lists is not there.
    """
    sources = _sources(type(method).__module__)
    if not sources and not type(method).__module__.startswith("bench."):
        return UNIDENTIFIED
    files = {f"file {name}": path for name, path in _listed_files(method)}
    return digest_of({name: digest_file(path) for name, path in (sources | files).items()})


def _sources(module: str) -> dict[str, Path]:
    """Sources of the package that holds a module, or of the modules beside it; none of this package, which counts by
    itself."""
    top = module.partition(".")[0]
    file = getattr(sys.modules.get(module), "__file__", None)
    if top == "bench" or file is None:
        return {}
    package = getattr(sys.modules.get(top), "__file__", None) if "." in module else file
    place = Path(package or file).resolve()
    if place.name == "__init__.py":
        paths = sorted(place.parent.rglob("*.py"))
    elif place.parent in [Path(folder).resolve() for folder in (*getsitepackages(), getusersitepackages())]:
        paths = [place]
    else:
        paths = sorted({place, *place.parent.glob("*.py")})
    return {path.relative_to(place.parent).as_posix(): path for path in paths}


def _listed_files(method: Scorable) -> Iterator[tuple[str, Path]]:
    """Name and path of every file that a method lists in `files`, folders walked."""
    for entry in method.files:
        path = Path(entry)
        if path.is_file():
            yield path.name, path
        elif path.is_dir():
            for file in sorted(file for file in path.rglob("*") if file.is_file()):
                yield f"{path.name}/{file.relative_to(path).as_posix()}", file
        else:
            raise UsageError(f"method {method.name!r}: files: expected a file or folder, got no such path {entry!r}")
