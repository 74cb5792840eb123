"""Stored runs that a test changes on purpose, with digests that fit again."""

import json
from collections.abc import Callable
from pathlib import Path

from bench.harness.stored import file_digests
from bench.recordings.checked_json import with_digest


def change_summary(run: Path, change: Callable[[dict], object] = lambda _: None) -> None:
    """Change `summary.json` and let it be of the tables that lie beside it."""
    content = json.loads((run / "summary.json").read_text())
    content["files"] = file_digests(run)
    change(content)
    (run / "summary.json").write_text(json.dumps(with_digest(content)))
