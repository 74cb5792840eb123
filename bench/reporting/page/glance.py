"""The run in a few sentences, each with its figures: what is good, what is bad, and where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.summary import ObjectFigures, Summary
from bench.reference import Category
from bench.reporting.numbers import percent
from bench.reporting.page.cells import clearly_below
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
    """The best and the weakest kind of motion where their intervals lie apart; all of them as they are otherwise."""
    told = {name: row.tpr_all for name, row in rows.items() if row.tpr_all.ci95 is not None}
    order = sorted(told, key=lambda name: told[name].value)
    if len(order) > 1 and clearly_below(told[order[0]], told[order[-1]]):
        left = [f"{_name(n).lower()} ({row.recordings})" for n, row in rows.items() if n not in told]
        few = f" Left out, with fewer than {FEWEST_RECORDINGS} recordings: {', '.join(left)}." if left else ""
        return [
            Remark(kind="good", text=f"Best: {_name(order[-1]).lower()}, {_found(rows[order[-1]])}.{few}"),
            Remark(kind="bad", text=f"Weakest: {_name(order[0]).lower()}, {_found(rows[order[0]])}."),
        ]
    if len(rows) == 1:
        return [Remark(kind="note", text=f"{_name(name)}: {_found(row)}.") for name, row in rows.items()]
    shares = ", ".join(f"{_name(name).lower()} {percent(row.tpr_all.value)}" for name, row in rows.items())
    text = f"Share of an object that is found, on average: {shares}; the recordings are too few to call one the best."
    return [Remark(kind="note", text=text)]


def _by_chance(rows: dict[str, ObjectFigures]) -> list[Remark]:
    """A rate that the mask of another image reaches too says nothing."""
    near, unknown = [], []
    for name, row in rows.items():
        figure_name = _HALF if _HALF in row.figure_names() else "detection_rate"
        rate, chance = row.figure(figure_name), row.figure(figure_name.replace("detection_rate", "chance")).value
        if rate.ci95 is None:
            unknown.append(f"{_name(name).lower()} ({row.recordings})")
        elif rate.ci95[0] < chance:
            near.append(f"{_name(name).lower()} ({percent(rate.value)}, by chance {percent(chance)})")
    touched = [n for n, row in rows.items() if row.detection_rate.value - row.chance.value < NEAR_CHANCE]
    told = []
    if unknown:
        text = f"Recordings too few to tell from chance, {FEWEST_RECORDINGS} are needed: {', '.join(unknown)}."
        told.append(Remark(kind="note", text=text))
    if near:
        text = f"Not clearly better than chance when half of an object must be found: {', '.join(near)}."
        told.append(Remark(kind="bad", text=text))
    if touched:
        names = ", ".join(_name(n).lower() for n in touched)
        text = f"“Found at all” says little for {names}: the mask of another image touches as many of these objects."
        told.append(Remark(kind="note", text=text))
    return told


def _weak_places(figures: Summary) -> list[Remark]:
    """The weakest slice of each breakdown, where its interval lies wholly below that of everything."""
    whole, told = figures.all_moving.tpr_all, []
    for name, words in _GROUPS.items():
        places = {key: row.tpr_all for key, row in figures.breakdowns.get(name, {}).items()}
        known = {key: figure for key, figure in places.items() if clearly_below(figure, whole)}
        if known:
            worst = min(known, key=lambda key: known[key].value)
            told.append(f"{words.format(worst)} with {percent(known[worst].value)}")
    if not told:
        return []
    return [
        Remark(
            kind="bad",
            text=f"Where least of an object is found (on average {percent(whole.value)}): {'; '.join(told)}.",
        )
    ]


def _false_positives(figures: Summary) -> list[Remark]:
    rate = figures.false_positives.coverage
    text = f"Wrongly marked as moving: {percent(rate.value, cases=rate.cases)} of the image on average"
    causes = figures.false_positive_causes
    if causes:
        order = sorted(causes, key=lambda name: -causes[name].value)
        named = [f"{name.replace('_', ' ')} with {percent(causes[name].value)}" for name in order[:2]]
        alone = len(order) == 1 or clearly_below(causes[order[1]], causes[order[0]])
        text += f"; the largest cause is {named[0]}" if alone else f"; the causes ahead are {' and '.join(named)}"
        text += " of the false pixels"
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
        f"{row.object_frames} object-frames of {row.tracks} objects in {row.recordings} recordings"
    )
