"""What differs between a run and its baseline beside the scores, and how to compare them image by image."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.evaluation.protocol import known_protocols
from bench.gate.baseline import Origin, ScoredRun
from bench.harness.method_stamp import flat_settings
from bench.plain_text import listed

SHOWN_DIGEST = 12  # characters of a digest that are shown
LISTED = 4  # recordings, or other differences, that a message lists
BASELINE_RUN = "reports/runs/baseline"
OF_ITSELF = ("method", "settings", "protocol", "code", "data", "reference")  # in the order that they are told


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Something that is not as in the baseline.

    Attributes:
        what: one of `OF_ITSELF`.
        text: what it is and what it was, one line.
    """

    what: str
    text: str


def changes(baseline: ScoredRun, run: ScoredRun) -> tuple[Change, ...]:
    """What changed, in the order of `OF_ITSELF`; what is not named is as it was."""
    found = [Change(what="protocol", text=f"{protocol_text(run)}, was {protocol_text(baseline)}")]
    found = [] if baseline.protocol == run.protocol else found
    if baseline.method.name != run.method.name:
        found.append(Change(what="method", text=f"{run.method.name!r}, was {baseline.method.name!r}"))
    elif settings := list(setting_changes(baseline, run)):
        found.append(Change(what="settings", text="; ".join(settings)))
    if code := list(_code_changes(baseline, run)):
        found.append(Change(what="code", text="; ".join(code)))
    if data := data_change(baseline, run):
        found.append(Change(what="data", text=f"other files, {data}"))
    if digest := digest_change(baseline.reference_fingerprint, run.reference_fingerprint):
        found.append(Change(what="reference", text=f"fingerprint {digest}"))
    return tuple(sorted(found, key=lambda change: OF_ITSELF.index(change.what)))


def setting_changes(baseline: ScoredRun, run: ScoredRun) -> Iterator[str]:
    """For example "flow = dis, was farneback"."""
    was, now = flat_settings(baseline.method.settings), flat_settings(run.method.settings)
    for name in sorted(was.keys() | now.keys()):
        if was.get(name) != now.get(name):
            yield f"{name} = {now.get(name)}, was {was.get(name)}"


def _code_changes(baseline: ScoredRun, run: ScoredRun) -> Iterator[str]:
    before, after = baseline.origin, run.origin
    if (before.version, before.commit) != (after.version, after.commit):
        yield f"{_code(after)}, was {_code(before)}"
    if before.python != after.python:
        yield f"Python {after.python}, was {before.python}"
    for name in sorted(before.libraries.keys() | after.libraries.keys()):
        was, now = before.libraries.get(name), after.libraries.get(name)
        if was != now:
            yield f"{name} {now or 'not loaded'}, was {was or 'not loaded'}"
    one, two = baseline.method, run.method
    if one.name == two.name and None not in (one.identity, two.identity) and one.identity != two.identity:
        yield "the method's own code, libraries or files"


def _code(origin: Origin) -> str:
    if origin.commit is None:
        return f"version {origin.version} of an unknown commit"
    dirty = " with changed files" if origin.commit.endswith("+") else ""
    return f"commit {origin.commit[:SHOWN_DIGEST].rstrip('+')}{dirty}"


def protocol_text(scored: ScoredRun) -> str:
    """For example "paper-v1 version 1 (dde8f4b79b8f)"."""
    stamp = scored.protocol
    return f"{stamp.name} version {stamp.version} ({stamp.digest[:SHOWN_DIGEST]})"


def digest_change(before: str, after: str) -> str | None:
    """For example "4be1a7c09d3e, was dde8f4b79b8f"; None where they are the same."""
    return None if before == after else f"{after[:SHOWN_DIGEST]}, was {before[:SHOWN_DIGEST]}"


def data_change(baseline: ScoredRun, run: ScoredRun) -> str | None:
    """For example "recordings changed: 'a' (1 of 20); fingerprint 4be1a7c09d3e, was dde8f4b79b8f"; None where equal."""
    digest = digest_change(baseline.data_fingerprint, run.data_fingerprint)
    if digest is None:
        return None
    return "; ".join([*_changed_recordings(baseline.recordings, run.recordings), f"fingerprint {digest}"])


def _changed_recordings(was: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Which have other data; nothing where a side is of a version that does not say."""
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


def how_to_compare(baseline: ScoredRun, run: ScoredRun, *, folder: Path, card: str) -> tuple[str, ...]:
    """Lines that tell how to make the baseline's run again and compare it with a run, with pictures of what changed.

    Args:
        baseline: which is sums only, without images.
        run: that was judged.
        folder: of that run.
        card: of its data set.
    """
    if hindrance := _why_not_again(baseline, run):
        return (f"no command makes the baseline's run again: {hindrance}",)
    known = baseline.protocol.name in known_protocols()
    protocol = baseline.protocol.name if known else str(folder / "protocol.json")
    words = ["fisheye-bench", "run", card, *baseline.method.options(), "--protocol", protocol]
    words += ["--split", baseline.split] if baseline.split is not None else []
    again = shlex.join([*words, "--out", BASELINE_RUN, "--no-pictures"])
    commit = _clean_commit(baseline.origin)
    place = f", the first in a checkout of {commit[:SHOWN_DIGEST]}" if commit != _clean_commit(run.origin) else ""
    return f"compare image by image{place}:", again, shlex.join(["fisheye-bench", "compare", BASELINE_RUN, str(folder)])


def _clean_commit(origin: Origin) -> str:
    return (origin.commit or "").rstrip("+")


def _why_not_again(baseline: ScoredRun, run: ScoredRun) -> str:
    """Why no command makes the baseline's run again; "" where one does."""
    if baseline.data_fingerprint != run.data_fingerprint:
        return "it is of other data"
    was, now = baseline.origin, run.origin
    if (was.commit is None and now.commit is not None) or (was.commit is None and was.version != now.version):
        return f"it is of version {was.version}, of an unknown commit"
    one, two = baseline.method, run.method
    own_code = one.place is not None and not one.place.startswith("bench.")
    if own_code and one.name == two.name and one.identity != two.identity:
        return f"the code of {one.name!r} is another now; run in the baseline's own commit"
    return ""
