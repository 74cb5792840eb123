"""Differences between a run and its baseline beside the scores, and how to compare them image by image."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from bench.evaluation.protocol import known_protocols
from bench.harness.digests import short_digest
from bench.harness.manifest import Aspect, Manifest, differences

LISTED = 4  # differences that a message lists
BASELINE_RUN = "reports/runs/baseline"
OF_ITSELF = ("method", "settings", "protocol", "code", "data", "reference")  # in the order that they are told
_TOLD_AS = {Aspect.METHOD_CODE: "code", Aspect.INPUT_ERRORS: "data"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Something that is not as in the baseline.

    Attributes:
        what: one of `OF_ITSELF`.
        text: what it is and what it was, one line.
    """

    what: str
    text: str


def changes(baseline: Manifest, run: Manifest) -> tuple[Change, ...]:
    """List what changed, in the order of `OF_ITSELF`; what is not named is as it was."""
    texts: dict[str, list[str]] = {}
    for one in differences(baseline, run):
        texts.setdefault(_TOLD_AS.get(one.aspect, str(one.aspect)), []).append(one.text)
    return tuple(Change(what=what, text="; ".join(texts[what])) for what in OF_ITSELF if what in texts)


def how_to_compare(baseline: Manifest, run: Manifest, *, folder: Path) -> tuple[str, ...]:
    """Lines that tell how to make the baseline's run again and compare it with a run, with pictures of what changed.

    Args:
        baseline: which is sums only, without images.
        run: that was judged.
        folder: of that run.
    """
    if hindrance := _why_not_again(baseline, run):
        return (f"no command makes the baseline's run again: {hindrance}",)
    known = baseline.protocol.name in known_protocols()
    protocol = baseline.protocol.name if known else str(folder / "protocol.json")
    words = ["fisheye-bench", "run", run.dataset.card, *baseline.method.options(), "--protocol", protocol]
    words += ["--split", baseline.dataset.split] if baseline.dataset.split is not None else []
    again = shlex.join([*words, "--out", BASELINE_RUN, "--no-pictures"])
    commit = baseline.code.commit
    other = "" if commit is None or commit == run.code.commit else short_digest(commit.rstrip("+"))
    place = f", the first in a checkout of {other}" if other else ""
    if (own := baseline.method.commit) and _of_other_code(baseline, run):
        place += f", the first with {baseline.method.name!r} as in commit {short_digest(own)}"
    return f"compare image by image{place}:", again, shlex.join(["fisheye-bench", "compare", BASELINE_RUN, str(folder)])


def _why_not_again(baseline: Manifest, run: Manifest) -> str:
    """Reason that no command makes the baseline's run again; "" where one does."""
    if baseline.dataset.recordings != run.dataset.recordings:
        return "it is of other data"
    was, now = baseline.code, run.code
    if (was.commit is None and now.commit is not None) or (was.commit is None and was.version != now.version):
        return f"it is of version {was.version}, of an unknown commit"
    if was.commit is not None and was.commit.endswith("+") and was.commit != now.commit:
        return f"it is of changed files on top of commit {short_digest(was.commit).rstrip('+')}"
    method = baseline.method
    if _of_other_code(baseline, run) and (method.commit is None or method.commit.endswith("+")):
        kind = "in no commit" if method.commit is None else f"changed since commit {short_digest(method.commit)}"
        return f"the code of {method.name!r} is another now, and the baseline's was {kind}"
    return ""


def _of_other_code(baseline: Manifest, run: Manifest) -> bool:
    """Both runs are of one method outside this package, whose code has changed."""
    one, two = baseline.method, run.method
    return not one.is_own and one.name == two.name and one.code_digest != two.code_digest
