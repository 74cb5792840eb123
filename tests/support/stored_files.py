"""Stored runs that a test changes on purpose, with digests that fit again."""

import json
from collections.abc import Callable
from pathlib import Path

from bench.harness.manifest import MANIFEST
from bench.harness.stored import file_digests
from bench.recordings.checked_json import with_digest


def change_summary(run: Path, change: Callable[[dict], object] = lambda _: None) -> None:
    """Change `summary.json` and let it be of the files that lie beside it."""
    content = json.loads((run / "summary.json").read_text())
    content["files"] = file_digests(run)
    change(content)
    (run / "summary.json").write_text(json.dumps(with_digest(content)))


def change_manifest(run: Path, change: Callable[[dict], object]) -> None:
    """Change `manifest.json` and let the summary be of it."""
    content = json.loads((run / MANIFEST).read_text())
    change(content)
    (run / MANIFEST).write_text(json.dumps(with_digest(content)))
    change_summary(run)
