"""Cards of data sets that tests write."""

from pathlib import Path

import yaml


def write_card(folder: Path, *, file: str = "x.yaml", **content: object) -> Path:
    """The card of native recordings in the folder `data` beside it, but for what `content` says otherwise."""
    usual = {"name": "x", "title": "x", "adapter": "native", "root": "data", "licence": "x"}
    (folder / file).write_text(yaml.safe_dump(usual | content))
    return folder / file
