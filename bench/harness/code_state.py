"""The commit that the code is of, and whether others can obtain it: committed unchanged, or installed as packed."""

from __future__ import annotations

import hashlib
import json
import subprocess
from base64 import urlsafe_b64encode
from collections import defaultdict
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from importlib import resources
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path

import bench
from bench.harness.digests import MethodCode

SHOWN = 20


def package_commit() -> str | None:
    """Commit of the checkout that the package runs from, "+" behind it where files were changed; or of the repository
    that pip installed it from; None where neither is known."""
    package = Path(bench.__file__).resolve().parent
    top, commit = _git(package, "rev-parse", "--show-toplevel"), _git(package, "rev-parse", "HEAD")
    if top is None or commit is None or Path(top.strip()).resolve() != package.parent:
        return _installed_commit(package)
    changed = _git(package, "status", "--porcelain", "--untracked-files=no")
    return commit.strip() + ("" if changed == "" else "+")


def _installed_commit(package: Path) -> str | None:
    """As `direct_url.json` of the installed distribution tells (PEP 610)."""
    try:
        installed = distribution("fisheye-bench")
    except PackageNotFoundError:
        return None
    if Path(str(installed.locate_file("bench"))).resolve() != package:
        return None  # what runs is another copy
    told = installed.read_text("direct_url.json")
    commit = json.loads(told).get("vcs_info", {}).get("commit_id") if told else None
    return str(commit) if commit else None


def method_commit(method_code: MethodCode) -> str | None:
    """Commit of the checkout that holds the module of a method's class, "+" behind it where a file of the method is
    changed or untracked; None where no commit holds that module."""
    module = method_code.place.partition(":")[0]
    path = next((file.path.resolve() for file in method_code.files if file.module and file.name == module), None)
    if path is None or _git(path.parent, "ls-files", "--error-unmatch", "--", path.name) is None:
        return None
    commit = _git(path.parent, "rev-parse", "HEAD")
    changed = any(_uncommitted(sorted(file.path.resolve() for file in method_code.files)))
    return None if commit is None else commit.strip() + ("+" if changed else "")


def commit_time(commit: str, folder: Path) -> datetime | None:
    """Time of a commit, UTC; None where the checkout that holds a folder does not have it."""
    told = _git(folder, "show", "--no-patch", "--format=%cI", "--end-of-options", f"{commit.rstrip('+')}^{{commit}}")
    return None if told is None else datetime.fromisoformat(told.strip()).astimezone(UTC)


def unrepeatable_code(method_code: MethodCode) -> tuple[str, ...]:
    """List the unrepeatable files of a run's code: of this package, and of the method, one line each.

    A file is repeatable when it is committed to git unchanged, or when an installed distribution lists it with the
    digest that it has.
    """
    files = sorted({path.resolve() for path in (*_own_sources(), *(file.path for file in method_code.files))})
    packed = _packed_digests(files)
    loose = [path for path in files if path not in packed]
    found = [f"{path}: changed since it was installed" for path in packed if packed[path] != _digest(path)]
    found += _uncommitted(loose)
    return tuple(found[:SHOWN])


def _own_sources() -> list[Path]:
    """Every file of this package that is code, or that decides what code does."""
    package = Path(str(resources.files("bench")))
    return [path for path in package.rglob("*") if path.suffix in {".py", ".yaml"}]


def _packed_digests(files: Iterable[Path]) -> dict[Path, str]:
    """Digests that installed distributions list, of those files that they list."""
    inside = [path for path in files if {"site-packages", "dist-packages"} & set(path.parts)]
    found: dict[Path, str] = {}
    for packed in distributions() if inside else ():
        folder = Path(str(packed.locate_file(""))).resolve()
        names = {path.relative_to(folder).as_posix(): path for path in inside if path.is_relative_to(folder)}
        for entry in packed.files or () if names else ():
            path = names.get(entry.as_posix())
            if path is not None and entry.hash is not None and entry.hash.mode == "sha256":
                found[path] = entry.hash.value
    return found


def _digest(path: Path) -> str:
    """As a RECORD writes it."""
    return urlsafe_b64encode(hashlib.sha256(path.read_bytes()).digest()).rstrip(b"=").decode()


def _uncommitted(files: Iterable[Path]) -> Iterator[str]:
    members_of: defaultdict[Path | None, list[Path]] = defaultdict(list)
    for path in files:
        members_of[next((folder for folder in path.parents if (folder / ".git").exists()), None)].append(path)
    for checkout, members in members_of.items():
        if checkout is None:
            yield from (f"{path}: in no checkout, and of no installed distribution" for path in members)
            continue
        names = [path.relative_to(checkout).as_posix() for path in members]
        committed = set((_git(checkout, "ls-files", "-z", "--", *names) or "").split("\0"))
        changed = set((_git(checkout, "diff", "--name-only", "-z", "HEAD", "--", *names) or "").split("\0"))
        for path, name in zip(members, names, strict=True):
            if name not in committed:
                yield f"{path}: untracked"
            elif name in changed:
                yield f"{path}: changed since it was committed"


def _git(folder: Path, *words: str) -> str | None:
    """Return the output of git; None where it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *words], capture_output=True, text=True, check=True, timeout=30
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout
