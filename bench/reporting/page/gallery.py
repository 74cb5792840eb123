"""The worst object-frames and images of a run as cards: a picture, the figures, the reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bench.reference import Category
from bench.reporting.page.frames import FrameView
from bench.reporting.page.reasons import frame_reason, object_reason
from bench.reporting.page.source import PageSource
from bench.reporting.page.worst import FrameKey, frame_key, worst_frames, worst_of_categories

Row = Mapping[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picked:
    """What the galleries show, worst first."""

    objects: dict[str, list[dict[str, object]]]
    frames: list[dict[str, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One card.

    Attributes:
        element: id of its element.
        key: its image.
        title: what it shows.
        facts: one line of figures.
        reason: in words.
        view: pictures; None without the data.
        track: of the object; empty for an image.
        close_up: the object enlarged; empty for an image or without the data.
    """

    element: str
    key: FrameKey
    title: str
    facts: str
    reason: str
    view: FrameView | None
    track: str
    close_up: str


def pick(source: PageSource, *, most: int) -> Picked:
    """Choose the worst: of each category, and, on a page of all, the images with most false positives."""
    categories = source.protocol.reference.categories if source.category is None else (source.category,)
    objects = worst_of_categories(source.objects, [Category(c) for c in categories], most=most)
    return Picked(objects=objects, frames=worst_frames(source.frames, most=most) if source.category is None else [])


def gallery_keys(picked: Picked) -> set[FrameKey]:
    """The images that the cards show."""
    return {frame_key(row) for rows in (*picked.objects.values(), picked.frames) for row in rows}


def object_cards(source: PageSource, picked: Picked, views: Mapping[FrameKey, FrameView]) -> dict[str, list[Card]]:
    """Cards of the worst object-frames by category."""
    threshold = source.run.method.settings.get("threshold")
    known = float(threshold) if isinstance(threshold, int | float) else None
    return {
        category: [
            _object_card(f"worst-{category}-{n}", row, views.get(frame_key(row)), known) for n, row in enumerate(rows)
        ]
        for category, rows in picked.objects.items()
    }


def frame_cards(source: PageSource, picked: Picked, views: Mapping[FrameKey, FrameView]) -> list[Card]:
    """Cards of the images with most false positives."""
    assert source.category is None or not picked.frames
    return [_frame_card(f"false-{n}", row, views.get(frame_key(row))) for n, row in enumerate(picked.frames)]


def _object_card(element: str, row: Row, view: FrameView | None, threshold: float | None) -> Card:
    track = str(row["track_id"])
    evidence = None if view is None else view.objects.get(track)
    coverage = float(str(row["coverage"]))
    return Card(
        element=element,
        key=frame_key(dict(row)),
        title=f"{100 * coverage:.0f} % found: {row['object_class']} “{track}”, {_place(row)}",
        facts=f"{row['range_m']:.1f} m away, {row['points']} lidar points, {row['region_px']} px, object "
        f"{row['speed_mps']:.1f} m/s, host {row['ego_speed_mps']:.1f} m/s",
        reason=object_reason(row, evidence, threshold=threshold),
        view=view,
        track=track,
        close_up="" if view is None else view.close_ups.get(track, ""),
    )


def _frame_card(element: str, row: Row, view: FrameView | None) -> Card:
    coverage = float(str(row["coverage"]))
    evidence = None if view is None else view.evidence
    return Card(
        element=element,
        key=frame_key(dict(row)),
        title=f"{100 * coverage:.0f} % of the image wrongly marked: {_place(row)}",
        facts=f"{row['fp_components']} false patches, the largest {row['fp_largest_px']} px, host "
        f"{row['ego_speed_mps']:.1f} m/s",
        reason=frame_reason(row, evidence),
        view=view,
        track="",
        close_up="",
    )


def _place(row: Row) -> str:
    return f"{row['recording']}, camera {row['camera']}, {int(str(row['timestamp_ns'])) / 1e9:.2f} s"
