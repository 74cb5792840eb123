"""Data-set cards: one YAML file gives the data set's folder, its adapter, and which parts count.

A card never holds data. Its `root` may name environment variables (`${FISHEYE_BENCH_REAL}/aimotive`), so that a card
can be committed while the data stays where each user keeps it.

A name is looked up in `datasets/` of the working folder, in the user's own folder of cards, and among the cards that
ship with the package. An installed package writes nothing beside itself: what its cards render goes to a cache folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal

from platformdirs import user_cache_path, user_config_path
from pydantic import AfterValidator, Field, model_validator

from bench.errors import DataError, UnknownNameError
from bench.plain_yaml import parse_yaml
from bench.recordings.annotations import Statement
from bench.recordings.files import read_text
from bench.recordings.validation import FileModel, in_order, validated

WORKING_FOLDER = Path("datasets")
OWN_CARDS, OWN_DATA = "FISHEYE_BENCH_DATASETS", "FISHEYE_BENCH_DATA"
RENDERED = PurePath("data")  # it holds the roots of the cards that ship


# First and last, both included; None for open.
Span = Annotated[tuple[int | None, int | None], AfterValidator(in_order)]


class Exclusion(FileModel):
    """Images that a card leaves out; without any limit the whole recording.

    Attributes:
        recording: name.
        reason: why.
        frames: images of each camera, counted from 0.
        timestamps_ns: times of images.
    """

    recording: str
    reason: str = Field(min_length=1)
    frames: Span | None = None
    timestamps_ns: Span | None = None

    @property
    def covers_all(self) -> bool:
        """True where the whole recording is left out."""
        return all(limit is None for span in (self.frames, self.timestamps_ns) for limit in span or ())

    def covers(self, frame: int, timestamp_ns: int) -> bool:
        """Return True where an image is left out."""
        return _within(frame, self.frames) and _within(timestamp_ns, self.timestamps_ns)


def _within(value: int, span: Span | None) -> bool:
    first, last = span or (None, None)
    return (first is None or value >= first) and (last is None or value <= last)


class CardFile(FileModel):
    """The keys of a card.

    Attributes:
        name: short name, as results carry it.
        title: one line for lists.
        adapter: a name of `ADAPTERS` or of an entry point.
        root: folder of the data; relative to the card (of cards that ship with the package, see `data_folder`),
            `${VARIABLE}` expanded.
        scenario: scenario file, relative to the card, that is rendered into `root` when that is missing.
        annotations: folder of annotation files apart from the data, relative to the card.
        annotated: "complete", "none", or which times and areas are; null for what each recording says of itself.
        licence: of the data.
        source: where the data set comes from.
        how_to_get: what a user does to have it.
        caveats: what a reader of its results has to know, above all where it differs from the paper's data.
        splits: name -> recordings, or "*" for all.
        exclusions: recordings, or parts of them, that are left out.
        options: the adapter's own.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    title: str
    adapter: str
    root: str
    scenario: str | None = None
    annotations: str | None = None
    annotated: Statement | None = None
    licence: str
    source: str = ""
    how_to_get: str = ""
    caveats: str = ""
    splits: dict[str, Literal["*"] | tuple[str, ...]] = Field(default={"all": "*"})
    exclusions: tuple[Exclusion, ...] = ()
    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_splits(self) -> CardFile:
        if not self.splits:
            raise ValueError("at least one split, for example {all: '*'}")
        for name, recordings in self.splits.items():
            if not name or set(name) & set(",[]"):
                raise ValueError(f"names of splits without commas and brackets, which choose recordings, not {name!r}")
            if len(set(recordings)) < len(recordings):
                raise ValueError(f"each recording once in the split {name!r}")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetCard:
    """A card and its file.

    Attributes:
        file: the card.
        content: what it says.
    """

    file: Path
    content: CardFile

    @property
    def name(self) -> str:
        """Short name."""
        return self.content.name

    @property
    def splits(self) -> tuple[str, ...]:
        """Names of the splits."""
        return tuple(self.content.splits)

    @property
    def root(self) -> Path:
        """Folder of the data, which need not exist.

        Raises:
            DataError: it names an environment variable that is not set, or an address.
        """
        return self._beside_card(self.content.root, "root")

    @property
    def address(self) -> str:
        """Path of the card for results and commands; its name where it ships with an installed package.

        The folder of a package is another one on each machine, and the name leads to the card on all of them.
        """
        return self.file.stem if _installed() and _same(self.file.parent, shipped_folder()) else str(self.file)

    @property
    def scenario(self) -> Path | None:
        """Scenario file that is rendered into `root` when that is missing; None where the data is recorded."""
        return None if self.content.scenario is None else self._beside_card(self.content.scenario, "scenario")

    @property
    def annotations(self) -> Path | None:
        """Folder of annotation files apart from the data; None for the data set's own."""
        return None if self.content.annotations is None else self._beside_card(self.content.annotations, "annotations")

    def _beside_card(self, path: str, field: str) -> Path:
        def expanded(match: re.Match[str]) -> str:
            value = os.environ.get(match[1])
            if not value:
                hint = f"set {match[1]}, for example: export {match[1]}=/path/to/data"
                hint += f"; {self.content.how_to_get}" if self.content.how_to_get else ""
                got = f"the variable {match[1]}, which is not set"
                raise DataError(self.file, field=field, expected="a folder", got=got, hint=hint)
            return value

        text = re.sub(r"\$\{(\w+)\}", expanded, path)
        if "://" in text:
            hint = "copy the data with the storage's own tool (aws s3 sync, gsutil rsync), or mount it (rclone mount)"
            raise DataError(self.file, field=field, expected="a folder of this machine", got="an address", hint=hint)
        place = Path(text).expanduser()
        data = data_folder()
        ships = data is not None and field == "root" and _same(self.file.parent, shipped_folder())
        if data is not None and ships and place.is_relative_to(RENDERED):
            return data / place.relative_to(RENDERED)
        return self.file.parent / place


def shipped_folder(kind: Literal["datasets", "baselines", "leaderboard"] = "datasets") -> Path:
    """Folder of cards, baselines or leaderboard that ship with the package: inside of it, or in the checkout."""
    package = Path(__file__).parents[1]
    installed = package / "shipped" / kind
    return installed if installed.is_dir() else package.parent / (kind if kind == "datasets" else f"reports/{kind}")


def data_folder() -> Path | None:
    """Folder of the data that the shipped cards render; None for beside the cards, as in a checkout.

    The folder that `FISHEYE_BENCH_DATA` names; without it, for an installed package, the user's cache folder.
    """
    named = os.environ.get(OWN_DATA)
    if named:
        return Path(named).expanduser()
    return user_cache_path("fisheye-bench", appauthor=False) / "data" if _installed() else None


def _installed() -> bool:
    return shipped_folder().parent.name == "shipped"


def card_folders() -> tuple[Path, ...]:
    """Folders in which names are looked up, in order: `datasets/`, the user's own, what ships with the package."""
    named = os.environ.get(OWN_CARDS)
    own = Path(named).expanduser() if named else user_config_path("fisheye-bench", appauthor=False) / "datasets"
    shipped = shipped_folder()
    first = () if _same(WORKING_FOLDER, shipped) else (shipped,)
    return (WORKING_FOLDER, own, *first)


def load_card(path_or_name: Path | str, *, folder: Path | None = None) -> DatasetCard:
    """Read a card.

    Args:
        path_or_name: path of a YAML file, or the name of one without its suffix.
        folder: the only one where names are looked up; None for `card_folders`.

    Raises:
        UnknownNameError: a name without a card; says where it was looked up.
        DataError: a card that is missing or says what a card cannot say, or a folder of data.
    """
    path = Path(path_or_name)
    if path.suffix not in {".yaml", ".yml"}:
        path = _find_card(str(path_or_name), card_folders() if folder is None else (folder,))
    elif not path.exists() and (shipped_folder() / path.name).is_file():
        hint = f"the card {path.stem!r} ships with the package and is found by this name, without folder and suffix"
        raise DataError(path, expected="a readable card", got="no such file", hint=hint)
    return DatasetCard(file=path, content=validated(CardFile, _read_yaml(path), file=path))


def list_cards(folder: Path) -> tuple[DatasetCard, ...]:
    """Every card of a folder, by file name; other YAML files, which have no `adapter`, are passed over.

    Raises:
        DataError: a card that cannot be read.
    """
    return tuple(load_card(path) for path in sorted(folder.glob("*.yaml")) if "adapter" in _read_yaml(path))


def _find_card(name: str, folders: Sequence[Path]) -> Path:
    for folder in folders:
        path = folder / f"{name}.yaml"
        if path.is_file():
            return path
    if Path(name).is_dir():
        hint = "write one whose `root` is this folder; `fisheye-bench new dataset NAME` makes an example"
        raise DataError(name, expected="a data set's card (a .yaml file)", got="a folder, which has none", hint=hint)
    known = {path.stem for folder in folders for path in folder.glob("*.yaml") if not path.stem.endswith(".scenario")}
    places = ", ".join(str(folder) for folder in folders)
    raise UnknownNameError("data set", name, known, hint=f"looked in {places}; a card elsewhere is named by its path")


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve()


def _read_yaml(path: Path) -> dict[str, Any]:
    values = parse_yaml(read_text(path, expected="a readable card"), file=path)
    if not isinstance(values, dict):
        raise DataError(path, expected="keys and values", got=type(values).__name__)
    return values
