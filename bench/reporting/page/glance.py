"""The run in a few sentences, each with its figures: what is good, what is bad, and where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.evaluation.summary import ObjectFigures, Summary
from bench.reference import Category
from bench.reporting.numbers import percent
from bench.reporting.tables import LABELS

NEAR_CHANCE = 0.05
_HALF = "detection_rate_50"
_GROUPS = {
    "object_class": "class {}",
    "range_m": "range {} m",
    "ego_speed_mps": "host speed {} m/s",
    "camera": "camera {}",
    "points": "{} lidar points",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """One sentence; `kind` gives its mark."""

    kind: Literal["good", "bad", "note"]
    text: str


def remarks(figures: Summary, *, category: Category | None) -> list[Remark]:
    """What a reader should know first."""
    rows = {name: row for name, row in figures.categories.items() if row.object_frames}
    if not rows:
        return [Remark(kind="note", text="No object-frame was evaluated: there is nothing to say of moving objects.")]
    told = [*_best_and_worst(rows), *_by_chance(rows), *_weak_places(figures)]
    return told if category is not None else [*told, *_false_positives(figures), *_missing(figures)]


def _best_and_worst(rows: dict[str, ObjectFigures]) -> list[Remark]:
    order = sorted(rows, key=lambda name: rows[name].tpr_all.value)
    if len(order) == 1:
        return [Remark(kind="note", text=f"{_name(order[0])}: {_found(rows[order[0]])}.")]
    return [
        Remark(kind="good", text=f"Best: {_name(order[-1]).lower()}, {_found(rows[order[-1]])}."),
        Remark(kind="bad", text=f"Weakest: {_name(order[0]).lower()}, {_found(rows[order[0]])}."),
    ]


def _by_chance(rows: dict[str, ObjectFigures]) -> list[Remark]:
    """A rate that the mask of another image reaches too says nothing."""
    near = []
    for name, row in rows.items():
        figure_name = _HALF if _HALF in row.figure_names() else "detection_rate"
        rate, chance = row.figure(figure_name), row.figure(figure_name.replace("detection_rate", "chance")).value
        least = rate.value - NEAR_CHANCE if rate.ci95 is None else rate.ci95[0]
        if least < chance:
            near.append(f"{_name(name).lower()} ({percent(rate.value)}, by chance {percent(chance)})")
    touched = [n for n, row in rows.items() if row.detection_rate.value - row.chance.value < NEAR_CHANCE]
    told = []
    if near:
        text = f"Not clearly better than chance when half of an object must be found: {', '.join(near)}."
        told.append(Remark(kind="bad", text=text))
    if touched:
        names = ", ".join(_name(n).lower() for n in touched)
        text = f"“Found at all” says little for {names}: the mask of another image touches as many of these objects."
        told.append(Remark(kind="note", text=text))
    return told


def _weak_places(figures: Summary) -> list[Remark]:
    """The weakest slice of each breakdown, where it stands out from the whole."""
    whole, told = figures.all_moving.tpr_all.value, []
    for name, words in _GROUPS.items():
        rows = {k: r for k, r in figures.breakdowns.get(name, {}).items() if r.object_frames}
        if len(rows) < 2:
            continue
        worst = min(rows, key=lambda key: rows[key].tpr_all.value)
        if whole - rows[worst].tpr_all.value >= 2 * NEAR_CHANCE:
            told.append(f"{words.format(worst)} with {percent(rows[worst].tpr_all.value)}")
    if not told:
        return []
    return [
        Remark(kind="bad", text=f"Where least of an object is found (on average {percent(whole)}): {'; '.join(told)}.")
    ]


def _false_positives(figures: Summary) -> list[Remark]:
    rate = figures.false_positives.coverage
    text = f"Wrongly marked as moving: {percent(rate.value, cases=rate.cases)} of the image on average"
    causes = figures.false_positive_causes
    if causes:
        name = max(causes, key=lambda key: causes[key].value)
        text += (
            f"; the largest cause is {name.replace('_', ' ')} with {percent(causes[name].value)} of the false pixels"
        )
    return [Remark(kind="bad" if rate.value > NEAR_CHANCE else "note", text=f"{text}.")]


def _missing(figures: Summary) -> list[Remark]:
    images = figures.images
    left = images.failed + images.skipped
    if not left:
        return []
    return [
        Remark(kind="bad", text=f"{left} of {images.images} images could not be scored; the last section says why.")
    ]


def _name(category: str) -> str:
    return LABELS[Category(category)].split(" (")[0]


def _found(row: ObjectFigures) -> str:
    return (
        f"on average {percent(row.tpr_all.value)} of an object is found, over "
        f"{row.object_frames} object-frames of {row.tracks} objects"
    )
