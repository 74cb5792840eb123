"""The manifest of a run: what it is of and what made it, and the one answer to what differs between two runs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions, version
from pathlib import Path
from site import getsitepackages, getusersitepackages
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict, Field

import bench
from bench.atomic import write_text
from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.digests import (
    ANSWER_CODE,
    COUNT_CODE,
    code_digest,
    digest_file,
    digest_of,
    library_versions,
    short_digest,
)
from bench.harness.exact import ORACLES, build_scorable
from bench.methods import METHODS, Scorable, known_methods
from bench.methods.contract import refuse_unfit
from bench.methods.settings import flat_settings
from bench.plain_text import listed
from bench.recordings.validation import read_json

MANIFEST = "manifest.json"
ANSWERS_MANIFEST = "run.json"
RECORDING_DIGEST_CHARS = 16  # characters of the digest of a recording's content that say whether it changed
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
        commit: of the checkout that its own code is of, "+" behind it where a file is not as committed; distribution
            and version of an installed one; None for a method of this package, and for code in no commit. It decides
            nothing.
    """

    name: str
    settings: dict[str, object]
    asked: dict[str, object] = Field(default_factory=dict)
    place: str
    history: int
    code_digest: str
    commit: str | None = None

    @classmethod
    def of(cls, method: Scorable, *, asked: Mapping[str, object] = MappingProxyType({})) -> MethodOfRun:
        """Record a method in this process.

        Raises:
            UsageError: `files` or `settings()` are not what the contract asks for.
        """
        refuse_unfit(method)
        kind = type(method)
        module = getattr(sys.modules.get(kind.__module__), "__file__", None)
        own = kind.__module__.partition(".")[0] == "bench"
        return cls(
            name=method.name,
            settings=json.loads(json.dumps(method.settings(), default=str)),
            asked=json.loads(json.dumps(dict(asked), default=str)),
            place=f"{kind.__module__}:{kind.__qualname__}",
            history=method.history,
            code_digest=method_digest(method),
            commit=None if own or module is None else _origin(kind.__module__, Path(module).resolve()),
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
        return self.name if self.place == known_methods().get(self.name) else self.place

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
# Aspects whose text says what it is of, with what stands between a name and its value.
_NAMED = {Aspect.SETTINGS: " = ", Aspect.INPUT_ERRORS: " = ", Aspect.CODE: " ", Aspect.METHOD_CODE: ""}


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
    found = [*_digests(before, after)]
    counted = isinstance(before, Manifest) and isinstance(after, Manifest)
    left_out: set[Aspect] = set() if counted else {Aspect.PROTOCOL}
    if before.method.name != after.method.name:
        left_out |= {Aspect.SETTINGS, Aspect.METHOD_CODE}
    was, now = dict(_values(before)), dict(_values(after))
    for aspect, name in sorted(key for key in was.keys() | now.keys() if was.get(key) != now.get(key)):
        absent = "not loaded" if aspect is Aspect.CODE else None
        values = (str(side.get((aspect, name), absent)) for side in (was, now))
        lead = f"{name}{_NAMED[aspect]}" if name else ""
        found.append(Difference(aspect=aspect, before=next(values), after=next(values), lead=lead, name=name))
    order = list(Aspect)
    kept = (one for one in found if one.aspect not in left_out)
    return tuple(sorted(kept, key=lambda one: order.index(one.aspect)))


def _values(manifest: AnswersManifest) -> Iterator[tuple[tuple[Aspect, str], object]]:
    """Values of a manifest, by aspect and name."""
    data, method = manifest.dataset, manifest.method
    yield (Aspect.DATASET, ""), repr(data.name)
    yield (Aspect.SPLIT, ""), "none" if data.split is None else repr(data.split)
    yield (Aspect.METHOD, ""), repr(method.name)
    if isinstance(manifest, Manifest):
        yield (Aspect.PROTOCOL, ""), protocol_text(manifest.protocol)
    for aspect, named in (
        (Aspect.INPUT_ERRORS, data.input_errors),
        (Aspect.SETTINGS, all_settings(method)),
        (Aspect.CODE, manifest.code.libraries),
    ):
        yield from (((aspect, name), value) for name, value in named.items())


def _digests(before: AnswersManifest, after: AnswersManifest) -> Iterator[Difference]:
    """Differences of what is told by digests; those of counts only where both are of results."""
    counted = isinstance(before, Manifest) and isinstance(after, Manifest)
    was, now = before.code, after.code
    code = [digest_of(one.answers, one.counts if counted else "") for one in (was, now)]
    if (was.version, was.commit) != (now.version, now.commit):
        decides = code[0] != code[1]
        yield Difference(aspect=Aspect.CODE, before=was.text, after=now.text, decides=decides)
        code = []
    recordings = [one.dataset.recordings for one in (before, after)]
    changed = "".join(f"{text}; " for text in _changed_recordings(*recordings))
    references = [one.reference for one in (before, after) if isinstance(one, Manifest)]
    told: list[tuple[Aspect, str, Sequence[str | None]]] = [
        (Aspect.CODE, f"other code of {now.text}: ", code),
        (Aspect.METHOD_CODE, "the method's own code, or files: ", [one.method.code_digest for one in (before, after)]),
        (Aspect.DATA, changed, [digest_of(one) for one in recordings] if changed else []),
        (Aspect.REFERENCE, "", references),
    ]
    for aspect, lead, digests in told:
        if len(digests) == 2 and None not in digests and digests[0] != digests[1]:
            texts = [short_digest(str(digest)) for digest in digests]
            yield Difference(aspect=aspect, before=texts[0], after=texts[1], lead=f"{lead}digest ")


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


def method_digest(method: Scorable) -> str:
    """Digest of a method's own code and of the files that it reads; `UNIDENTIFIED` where no file holds the code.

    Raises:
        UsageError: a file that it lists is not there.
    """
    sources = dict(_sources(type(method).__module__))
    if not sources and not type(method).__module__.startswith("bench."):
        return UNIDENTIFIED
    files = {f"file {name}": path for name, path in _listed_files(method)}
    return digest_of({name: digest_file(path) for name, path in (sources | files).items()})


def _sources(module: str) -> Iterator[tuple[str, Path]]:
    """Sources of the package that holds a module, or of the modules beside it; none of this package, which counts by
    itself."""
    top = module.partition(".")[0]
    file = getattr(sys.modules.get(module), "__file__", None)
    if top == "bench" or file is None:
        return
    package = getattr(sys.modules.get(top), "__file__", None) if "." in module else file
    place = Path(package or file).resolve()
    if place.name == "__init__.py":
        found = sorted(place.parent.rglob("*.py"))
    elif place.parent in _libraries():
        found = [place]
    else:
        found = sorted({place, *place.parent.glob("*.py")})
    for path in found:
        yield path.relative_to(place.parent).as_posix(), path


def _listed_files(method: Scorable) -> Iterator[tuple[str, Path]]:
    """Name and path of every file that a method lists in `files`, folders walked."""
    for entry in method.files:
        path = Path(entry)
        if path.is_file():
            yield path.name, path
        elif path.is_dir():
            for file in sorted(found for found in path.rglob("*") if found.is_file()):
                yield f"{path.name}/{file.relative_to(path).as_posix()}", file
        else:
            raise UsageError(f"method {method.name!r}: files: expected a file or folder, got no such path {entry!r}")


def _origin(module: str, file: Path) -> str | None:
    if any(file.is_relative_to(folder) for folder in _libraries()):
        names = packages_distributions().get(module.partition(".")[0], ())
        return ", ".join(f"{name} {version(name)}" for name in names) or None
    return commit_of(file)


def _libraries() -> list[Path]:
    return [Path(folder).resolve() for folder in (*getsitepackages(), getusersitepackages())]


def commit_of(file: Path) -> str | None:
    """Commit of the checkout that holds a file, "+" behind it where files of its folder are not as committed; None
    where no commit holds it."""
    if _git(file.parent, "ls-files", "--error-unmatch", "--", file.name) is None:
        return None
    commit, changed = _git(file.parent, "rev-parse", "HEAD"), _git(file.parent, "status", "--porcelain", "--", ".")
    return None if commit is None else commit.strip() + ("" if changed == "" else "+")


def _git(folder: Path, *words: str) -> str | None:
    """Return the output of git; None where it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout
