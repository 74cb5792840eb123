"""Stored runs that a test changes on purpose."""

import json
from collections.abc import Callable
from pathlib import Path

from bench.harness.manifest import MANIFEST
from bench.harness.stored import results_folder


def change_summary(run: Path, change: Callable[[dict], object] = lambda _: None) -> None:
    """Change `summary.json`."""
    _change(results_folder(run) / "summary.json", change)


def change_manifest(run: Path, change: Callable[[dict], object]) -> None:
    """Change `manifest.json`."""
    _change(results_folder(run) / MANIFEST, change)


def _change(file: Path, change: Callable[[dict], object]) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
