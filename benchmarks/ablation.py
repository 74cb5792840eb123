"""Worth of each group of channels of `learned`, and of each kind of training image.

python -m benchmarks.ablation --cache DIR --out DIR (extra `train`; hours; continues where it was interrupted). The
network is trained whole, without each group of channels, without each kind of training image, and on images as they
were rendered, from several seeds, with random weights or those of an exported network. All trainings are alike and
shorter than that of the shipped weights, so their scores compare with each other alone. Where images are left out,
others are seen more often: trainings are equally long. A third of the validation drives chooses the epoch; the others
are scored, as they were rendered and as worse cameras would have taken them, and those of each kind alone.
`DIR/ablation.csv` has every training, the tables that are printed the means.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import torch
import typer

from bench.atomic import make_folder, write_text
from bench.errors import UsageError
from bench.execution import usable_cores
from bench.methods.learned.inputs import GROUPS
from bench.recordings import load_card
from bench.reporting.document import Table, to_markdown
from bench.synthesis.production import read_scenario
from bench.synthesis.scenario import RecordingSpec
from bench.training.pairs import DATASET, PreparedDrive, prepare
from bench.training.train import Plan, Validation, train, validate

WHOLE, AS_RENDERED = "nothing", "worse cameras"
METRICS = {"iou_of_images": "IoU of images", "false_positives": "false positives"}
CHOOSES = 3  # every third validation drive chooses the epoch
KINDS: dict[str, Callable[[RecordingSpec, str], bool]] = {  # whether the images of a camera on a drive are of it
    "night": lambda drive, _: drive.light.kind == "night",
    "low sun": lambda drive, _: drive.light.kind == "low_sun",
    "wet roads": lambda drive, _: drive.street.wet,
    "farther away": lambda drive, _: drive.name.startswith("farther-away"),
    "rolling shutter": lambda _, camera: camera == "high",
    "crowds": lambda drive, _: drive.name.startswith(("crowd", "people-all-around")),
    "queues": lambda drive, _: drive.name.startswith(("stop-and-go", "creeping-ahead")),
    "large and near": lambda drive, _: drive.name.startswith(("lorries-alongside", "large-ones")),
}
ON_KINDS = {kind: f"IoU of images, {kind}" for kind in KINDS}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drives:
    """Prepared inputs: of training, disturbed or not, and of validation as it was rendered and disturbed.

    Attributes:
        training: by whether images are disturbed.
        rendered: of validation.
        disturbed: of validation.
        specs: what the drives were rendered from, by name.
    """

    training: dict[bool, list[PreparedDrive]]
    rendered: list[PreparedDrive]
    disturbed: list[PreparedDrive]
    specs: Mapping[str, RecordingSpec]


def of_kind(
    kind: str, drives: Sequence[PreparedDrive], specs: Mapping[str, RecordingSpec], *, others: bool = False
) -> list[PreparedDrive]:
    """Drives and cameras whose images are of a kind, or the others.

    Args:
        kind: of `KINDS`.
        drives: prepared.
        specs: what they were rendered from, by name.
        others: those that are not of the kind.
    """
    return [drive for drive in drives if KINDS[kind](specs[drive.recording], drive.camera) != others]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A training: its plan, and the kind of training image that it does not see."""

    plan: Plan
    unseen: str | None = None


def variants(plan: Plan) -> dict[str, Variant]:
    """The whole network, and what is left out, by name."""
    found = {WHOLE: Variant(plan=plan)}
    found |= {name: Variant(plan=replace(plan, without=(name,))) for name in GROUPS}
    found |= {name: Variant(plan=plan, unseen=name) for name in KINDS}
    return found | {AS_RENDERED: Variant(plan=replace(plan, disturbed=False))}


def seen_drives(
    drives: list[PreparedDrive], specs: Mapping[str, RecordingSpec], unseen: str | None
) -> list[PreparedDrive]:
    """As many of the drives, without a kind of images; others come twice in their place.

    Args:
        drives: prepared.
        specs: what they were rendered from, by name.
        unseen: of `KINDS`, or None for all of them.
    """
    if unseen is None:
        return drives
    others = of_kind(unseen, drives, specs, others=True)
    again = np.random.default_rng(0).permutation(len(others))[: len(drives) - len(others)]
    return others + [others[k] for k in again]


def score(variant: Variant, drives: Drives, out: Path, start: Path | None = None) -> dict[str, float]:
    """Train, and score on validation drives that had no part in it."""
    plan = variant.plan
    training = seen_drives(drives.training[plan.disturbed], drives.specs, variant.unseen)
    names = sorted({drive.recording for drive in drives.rendered})[::CHOOSES]
    choosing = [drive for drive in drives.rendered if drive.recording in names]
    network, _, log = train(plan, training, choosing, out, start=start)
    found = {"minutes": sum(line["seconds"] for line in log) / 60}
    rendered, disturbed = (
        validate(network, [drive for drive in scored if drive.recording not in names], plan, "cpu")
        for scored in (drives.rendered, drives.disturbed)
    )
    for name, summary in (("as rendered", rendered.summary()), ("worse cameras", disturbed.summary())):
        found |= {f"{label}, {name}": summary[metric] for metric, label in METRICS.items()}
    for kind, column in ON_KINDS.items():
        of_it = {(drive.recording, drive.camera) for drive in of_kind(kind, drives.rendered, drives.specs)}
        rows = [row for row, name in enumerate(rendered.names) if name in of_it]
        names_of_it = [rendered.names[row] for row in rows]
        alone = Validation(names=names_of_it, true=rendered.true[rows], false=rendered.false[rows])
        found[column] = alone.summary()["iou_of_images"] if rows else np.nan
    return found


def tables(rows: pd.DataFrame) -> str:
    """Markdown: means over the seeds in percent, and each seed's change against the whole network of that seed.

    All scored drives first; then, for each kind of training image, those of that kind.
    """
    scores = rows.set_index(["left out", "seed"]).drop(columns="minutes") * 100
    lost = scores - scores.xs(WHOLE).reindex(scores.index, level="seed")
    names = list(dict.fromkeys(rows["left out"]))

    def cells(name: str, column: str) -> list[str]:
        changes = "" if name == WHOLE else ", ".join(f"{change:+.1f}" for change in lost.loc[name, column])
        return [f"{scores.loc[name, column].mean():.1f}", changes]

    everywhere = [column for column in scores if column not in ON_KINDS.values()]
    of_all = Table(
        columns=["left out", *(heading for column in everywhere for heading in (column, "change by seed"))],
        rows=[[name, *(cell for column in everywhere for cell in cells(name, column))] for name in names],
    )
    of_kinds = Table(
        columns=["IoU of images that are of a kind", "seen", "left out", "change by seed"],
        rows=[[kind, cells(WHOLE, on)[0], *cells(kind, on)] for kind, on in ON_KINDS.items() if kind in names],
    )
    return to_markdown([of_all, of_kinds])


def main(
    cache: Annotated[Path, typer.Option(help="folder of prepared inputs, as of bench.training.train")],
    out: Annotated[Path, typer.Option(help="folder of checkpoints and of ablation.csv")],
    epochs: Annotated[int, typer.Option(min=1)] = 4,
    seeds: Annotated[int, typer.Option(min=1)] = 2,
    crop_px: Annotated[tuple[int, int], typer.Option(help="rows, columns; multiples of 16")] = (96, 128),
    rate: Annotated[float, typer.Option(min=0.0, help="largest learning rate")] = 3e-3,
    start: Annotated[Path | None, typer.Option(help="learned.onnx, beside its card, to begin with")] = None,
    only: Annotated[list[str] | None, typer.Option(help="what is left out; everything in turn without")] = None,
    workers: Annotated[int, typer.Option(min=1, help="processes that prepare; threads that train")] = usable_cores(),
) -> None:
    """Train all variants from all seeds and tabulate them."""
    torch.set_num_threads(workers)
    begun = "" if start is None else hashlib.sha256(start.read_bytes()).hexdigest()
    known = variants(Plan(epochs=epochs, crop_px=crop_px, rate=rate, bfloat16=True, start=begun))
    if unknown := sorted(set(only or ()) - known.keys()):
        raise UsageError(f"--only: expected some of {', '.join(known)}, got {', '.join(unknown)}")
    chosen = {name: variant for name, variant in known.items() if not only or name in (WHOLE, *only)}
    ready = partial(prepare, DATASET, folder=cache, workers=workers, progress=lambda *_: None)
    scenario = load_card(DATASET).scenario
    assert scenario is not None, "rendered"
    drives = Drives(
        training={
            disturbed: ready("training", disturbed=disturbed)
            for disturbed in {variant.plan.disturbed for variant in chosen.values()}
        },
        rendered=ready("validation", disturbed=False),
        disturbed=ready("validation", disturbed=True),
        specs={drive.name: drive for drive in read_scenario(scenario).recordings},
    )
    rows = []
    for seed in range(1, seeds + 1):
        for name, variant in chosen.items():
            folder = out / f"{name.replace(' ', '-')}-{seed}"
            make_folder(folder)
            planned = replace(variant, plan=replace(variant.plan, seed=seed))
            rows.append({"left out": name, "seed": seed, **score(planned, drives, folder, start)})
            write_text(out / "ablation.csv", pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))
            typer.echo(rows[-1])
    typer.echo(tables(pd.DataFrame(rows)))


if __name__ == "__main__":
    typer.run(main)
