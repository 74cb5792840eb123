"""Stored runs that a test changes on purpose, with digests that fit again."""

import json
from collections.abc import Callable
from pathlib import Path

from bench.harness.stored import file_digests


def change_summary(run: Path, change: Callable[[dict], object] = lambda _: None) -> None:
    """Change `summary.json` and let it be of the tables that lie beside it; the result bears no seal."""
    content = json.loads((run / "summary.json").read_text())
    content.pop("sha256", None)
    content["files"] = file_digests(run)
    change(content)
    (run / "summary.json").write_text(json.dumps(content))
