"""Stored runs that a test changes on purpose."""

from collections.abc import Callable
from pathlib import Path

from bench.harness.manifest import MANIFEST
from bench.harness.stored import results_folder
from tests.support.planting import change_json


def change_summary(run: Path, change: Callable[[dict], object] = lambda _: None) -> None:
    """Change `summary.json`."""
    change_json(results_folder(run) / "summary.json", change)


def change_manifest(run: Path, change: Callable[[dict], object]) -> None:
    """Change `manifest.json`."""
    change_json(results_folder(run) / MANIFEST, change)
