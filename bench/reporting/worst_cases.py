"""The worst object-frames and images of a run with their pictures, and the table of all its object-frames."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
import pyarrow as pa

from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, Rows
from bench.evaluation.definitions import coverage, false_share, intersection_over_union
from bench.evaluation.protocol import known_protocols
from bench.evaluation.rows import EVALUATED, IMAGE, OBJECT, pick, read_parts, sort_rows
from bench.harness import ProcessedFrame
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.reference import Status
from bench.reporting.document import Block, Cell, Column, Group, Heading, Heads, Paragraph, Picture, Table
from bench.reporting.figures import figure_uri
from bench.reporting.formats import LABELS, frame_name, image_name
from bench.reporting.frame import draw_close_up, draw_frames, scored_layers
from bench.reporting.frame_pictures import ImageKey, draw_images, draw_panels

Row = Mapping[str, Any]  # of a stored table, with `coverage`


def worst_objects(objects: Rows, *, most: int) -> list[Row]:
    """Of each category the evaluated object-frames with the lowest coverage, one of each track, of equals the largest.

    Returns:
        Rows of `OBJECTS_SCHEMA` plus `coverage`.
    """

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows.sort_values(["coverage", "region_px"], ascending=[True, False], kind="stable")
        return ranked.drop_duplicates(["category", *IMAGE[:2], "track_id"]).groupby("category").head(most)

    return _scored(objects, OBJECTS_SCHEMA, OBJECT, coverage, first)


def worst_frames(frames: Rows, *, most: int) -> list[Row]:
    """The scored images with the largest false-positive coverage, one of each recording and camera.

    Returns:
        Rows of `FRAMES_SCHEMA` without the histograms, plus `coverage`, here of false positives.
    """

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows[rows["fp_px"] > 0].sort_values("coverage", ascending=False, kind="stable")
        return ranked.drop_duplicates(IMAGE[:2]).head(most)

    return _scored(frames, FRAMES_SCHEMA, IMAGE, false_share, first)


def _scored(
    source: Rows,
    schema: pa.Schema,
    key: Sequence[str],
    measure: Callable[[pd.DataFrame], pd.Series[float]],
    first: Callable[[pd.DataFrame], pd.DataFrame],
) -> list[Row]:
    flat = [column.name for column in schema if not pa.types.is_list(column.type)]
    scored = (part[part["status"] == EVALUATED] for part in read_parts(source, flat))
    chosen = first(pick((sort_rows(part, key).assign(coverage=measure) for part in scored), first))
    return [{str(name): value for name, value in row.items()} for row in chosen.to_dict("records")]


OBJECT_NOTE = "Hidden: share of the outline that lies behind nearer objects."
IMAGE_NOTE = (
    "Of the falsely marked pixels: largest, those in the largest connected patch; at objects, in patches that touch a "
    "moving object; cause, the most frequent."
)


def object_facts(row: Row) -> dict[str, str]:
    """What was measured of an evaluated object-frame, a row of `OBJECTS_SCHEMA` with `coverage`, by heading."""
    return {
        "found": _percent(row["coverage"]),
        "range": f"{row['range_m']:.1f} m",
        "lidar points": f"{row['points']:.0f}",
        "size": f"{row['region_px']:.0f} px",
        "hidden": _percent(1 - row["region_px"] / row["polygon_px"]),
        "speed": f"{row['speed_mps']:.1f} m/s",
        "ego vehicle": f"{row['ego_speed_mps']:.1f} m/s",
    }


def image_facts(row: Row) -> dict[str, str]:
    """What was measured of the false positives of an image, a row of `FRAMES_SCHEMA` with `coverage`, by heading."""
    false_px = max(row["fp_px"], 1)
    causes = row["fp_by_cause"] if isinstance(row["fp_by_cause"], Mapping) else {}
    cause, pixels = max(causes.items(), key=lambda item: item[1], default=("", 0))
    return {
        "wrongly marked": _percent(row["coverage"]),
        "patches": f"{row['fp_components']}",
        "largest": _percent(row["fp_largest_px"] / false_px),
        "at objects": _percent(1 - row["fp_unattached_px"] / false_px),
        "cause": f"{cause.replace('_', ' ')} {_percent(pixels / false_px)}" if cause else "",
        "ego vehicle": f"{row['ego_speed_mps']:.1f} m/s",
    }


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One object-frame or image.

    Attributes:
        element: id of its element.
        key: its image.
        track: of the object; "" for an image.
        title: what it shows.
        facts: what was measured, by heading.
        pictures: of it; none without the data.
    """

    element: str
    key: ImageKey
    track: str = ""
    title: str
    facts: Mapping[str, str]
    pictures: Sequence[Block] = ()


def worst_cases(
    run: StoredRun, *, most: int, pictures: bool, progress: Progress | None = None
) -> tuple[dict[str, list[Card]], list[str]]:
    """Choose the worst of each category and of the images, and draw them.

    Args:
        run: the run.
        most: cards of a category, and of images.
        pictures: process the images once more.
        progress: called with the images done and their number.

    Returns:
        galleries: by title those of each category, then that of the images, the worst first.
        problems: why pictures are missing, one line each.
    """
    objects, images = worst_objects(run.objects, most=most), worst_frames(run.frames, most=most)
    cards: dict[str, list[Card]] = {LABELS[category]: [] for category in run.protocol.reference.categories}
    for row in objects:
        key, track, of_kind = _image_key(row), row["track_id"], cards[LABELS[row["category"]]]
        title, element = f"{row['object_class']} “{track}”, {image_name(*key)}", f"{row['category']}-{len(of_kind)}"
        of_kind.append(Card(element=element, key=key, track=track, title=title, facts=object_facts(row)))
    cards["Most false marks"] = [
        Card(element=f"false-{n}", key=_image_key(row), title=image_name(*_image_key(row)), facts=image_facts(row))
        for n, row in enumerate(images)
    ]
    keys = {card.key for of_kind in cards.values() for card in of_kind} if pictures else set()
    drawn, problems = draw_images([run], keys, lambda _, frames, __: _pictures(frames[0]), progress=progress)
    galleries = {
        title: [replace(card, pictures=_shown(card, drawn.get(card.key, {}))) for card in of_kind]
        for title, of_kind in cards.items()
    }
    return galleries, problems


def _image_key(row: Row) -> ImageKey:
    return row["recording"], row["camera"], row["timestamp_ns"]


def _pictures(processed: ProcessedFrame) -> dict[str, str]:
    """Addresses of the "areas", of the "panels", and of each evaluated object enlarged, "track <id>"."""
    reference, name, layers = processed.reference, frame_name(processed.reference), scored_layers(processed)
    drawn = {
        f"track {target.track_id}": figure_uri(draw_close_up(layers, target, name=name))
        for target in reference.objects
        if target.status is Status.EVALUATED
    }
    return drawn | {
        "areas": figure_uri(draw_frames([layers], name=name)),
        "panels": figure_uri(draw_panels(processed)),
    }


def _shown(card: Card, drawn: Mapping[str, str]) -> list[Block]:
    """The picture of a card, the object enlarged, and what each step saw."""
    if not drawn:
        return []
    areas = Picture(drawn["areas"], f"Camera image of {card.title}: green found, blue missed, orange wrong")
    close = [Picture(drawn[f"track {card.track}"], f"{card.title}, enlarged")] if card.track else []
    panels = Picture(drawn["panels"], f"Flow, deviations, likelihood and segmentation of {card.title}")
    return [areas, *close, Group(look="folded", title="Panels: what each step saw", blocks=[panels])]


def gallery(title: str, cards: Sequence[Card], *, missing: str) -> Iterator[Block]:
    """The cards as rows that lead to their pictures below.

    Args:
        title: names the kind.
        cards: the worst first; a kind without any is left out.
        missing: why a card has no picture.
    """
    if cards:
        rows = [[Cell(card.title, link=f"#{card.element}"), *card.facts.values()] for card in cards]
        yield Heading(title, 3)
        yield Table(title=f"{title}, the worst first", columns=["", *cards[0].facts], rows=rows)
        none = [Paragraph(f"No picture: {missing}.", "warn")]
        boxes = [Group(look="box", name=card.element, title=card.title, blocks=card.pictures or none) for card in cards]
        yield Group(look="boxes", blocks=boxes)


# The table of object-frames.

LISTED = 2_000  # 1 MB of the page
FILTERS = {"kind": "Kind", "class": "Class", "outcome": "Outcome", "camera": "Camera", "recording": "Recording"}
_READ = (
    *OBJECT,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)


def _number(digits: int, *, times: float = 1.0) -> Callable[[float], str]:
    return lambda value: "" if math.isnan(value) else f"{times * value:.{digits}f}"


_COLUMNS: dict[str, Heads] = {
    "object": "object",
    **{name: name for name in ("recording", "camera", "class", "kind", "outcome")},
    "timestamp_ns": "time (ns)",
    "iou": Column("IoU %", _number(1, times=100)),
    "coverage": Column("TPR %", _number(1, times=100)),
    "fp": Column("false px", _number(0)),
    "region_px": Column("object px", _number(0)),
    "range_m": Column("range (m)", _number(1)),
    "ego_speed_mps": Column("ego (km/h)", _number(1, times=3.6)),
    "points": Column("points", _number(0)),
}


def object_table(run: StoredRun, cards: Sequence[Card] = (), *, most: int = LISTED) -> tuple[Table, int]:
    """Every annotated object-frame as a row; and how many there are in all.

    Args:
        run: of the page.
        cards: to which rows lead.
        most: rows; the evaluated with the lowest coverage come first, of equals the largest, and then the others.
    """
    annotated = 0

    def parts() -> Iterator[pd.DataFrame]:
        nonlocal annotated
        for part in read_parts(run.objects, _READ):
            annotated += len(part)
            rows = sort_rows(part, OBJECT)
            scored = rows["status"] == EVALUATED
            measured = {"coverage": coverage(rows), "iou": intersection_over_union(rows)}
            measured |= {name: rows[name].astype(float) for name in ("fp", "region_px")}
            yield rows.assign(scored=scored, **{name: of.where(scored) for name, of in measured.items()})

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        order = ["scored", "coverage", "region_px"]
        return rows.sort_values(order, ascending=[False, True, False], kind="stable", ignore_index=True).head(most)

    rows = first(pick(parts(), first))
    status, reason, kind = (rows[name].astype(object).fillna("") for name in ("status", "reason", "category"))
    links = {(*card.key, card.track): f"#{card.element}" for card in reversed(cards) if card.pictures}
    keys = rows[OBJECT].itertuples(index=False, name=None)
    shown = rows.rename(columns={"object_class": "class"}).assign(
        object=pd.Series([Cell(key[3], link=links.get(key, "")) for key in keys], rows.index, dtype=object),
        outcome=status.where(reason == "", status + ": " + reason.str.replace("_", " ")),
        kind=kind.str.replace("_", " "),
    )
    tags = [dict(zip(FILTERS, row, strict=True)) for row in shown[[*FILTERS]].astype(str).itertuples(index=False)]
    title = "Annotated object-frames; TPR (coverage) and IoU in percent"
    return Table(title=title, columns=_COLUMNS, rows=shown, words=6, tags=tags, look="dense"), annotated


def view_command(run: StoredRun) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    words = ["fisheye-bench", "view", run.manifest.dataset.card, *run.manifest.method.options()]
    known = run.protocol.name in known_protocols()
    words += ["--protocol", run.protocol.name if known else str(run.folder / "protocol.json")]
    return " ".join(map(shlex.quote, words)) + " --recording RECORDING --camera CAMERA --time-ns TIME"
