"""Train the network of the method `learned`: `python -m bench.training.train --out DIR` (extra `train`).

The data are rendered and the network's inputs prepared where that is missing; both continue where they were
interrupted, and so does the training, from the last whole epoch. Everything random follows from the seed.
`DIR` then holds `learned.onnx` and its card `learned.json`, and `log.csv`. To score what was trained:
`fisheye-bench run demo --method learned --set weights=DIR/learned.onnx`.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import pandas as pd
import torch
import typer
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from bench import __version__
from bench.atomic import make_folder, replacing, write_bytes, write_text
from bench.errors import UsageError
from bench.evaluation.intervals import ratio_interval
from bench.execution import usable_cores
from bench.methods.learned.inputs import COARSE, DIFFERENCES, FINE, GROUPS, MIRRORED, ZERO, Channels
from bench.methods.learned.method import padded
from bench.recordings import load_card
from bench.training.network import MotionNetwork, ScoredNetwork, begin_with
from bench.training.pairs import DATASET, GREY, LEAST_PX, PreparedDrive, prepare, valid_region, vary

LOG = logging.getLogger(__name__)
CROPS_ON_MOTION = 0.5  # share of the crops that are put around something that moves, where anything does
HARD = 0.5  # share of the draws that go by the loss of an image when it was last seen
STRANGE = 0.3  # share of the crops of strange contrast, from negative over none to strong: motion tells, not looks
WITHOUT_EARLIER = 0.1  # share of the crops that are shown without the earlier image, as at the start of a drive
AVERAGED = 0.998  # of the running mean of the weights, which is what is validated and exported
WARM_UP = 0.05  # of all steps
MOVING_WEIGHT = 2.0  # of moving pixels in the cross-entropy; static ones are fifty times as many
SMALL_PX, SMALL_WEIGHT = 4000.0, 4.0  # objects of fewer fine pixels count more, by the root of their size, to so much
SMOOTH_PX = 64.0  # fine pixels, of the soft IoU of a crop
THRESHOLDS = 100  # that validation tries
CHECKPOINT = "checkpoint.pt"
STATISTICS_BATCHES = 16  # of crops from which normalisation is made again
# Channels that are varied together.
VARIED = {
    "mirrored": MIRRORED,
    "grey": GREY,
    "differences": DIFFERENCES,
    "earlier": GROUPS["earlier"],
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Everything that decides the weights, beside the data.

    Attributes:
        without: groups of channels that the network is not shown, see `bench.methods.learned.inputs`.
        disturbed: images are those of worse cameras, too, see `bench.training.appearance`; also those that choose the
            threshold.
        epochs: each draws as many images as there are; the learning rate falls to 0 by the last.
        batch: crops of a step.
        crop_px: rows, columns of the coarse channels; multiples of 16, no larger than the smallest images.
        rate: largest learning rate.
        decay: of the weights.
        bfloat16: computes in 16 bits, which takes half the time on processors that can.
        start: SHA-256 of the exported network whose weights it begins with; "" for random ones.
        seed: of everything random.
    """

    without: tuple[str, ...] = ()
    disturbed: bool = True
    epochs: int = 20
    batch: int = 8
    crop_px: tuple[int, int] = (192, 256)
    rate: float = 3e-3
    decay: float = 1e-2
    bfloat16: bool = False
    start: str = ""
    seed: int = 1

    @property
    def coarse(self) -> tuple[str, ...]:
        """Names of the coarse channels that the network is shown."""
        return self._shown(COARSE)

    @property
    def fine(self) -> tuple[str, ...]:
        """Names of the fine ones."""
        return self._shown(FINE)

    @property
    def rows(self) -> tuple[list[int], list[int]]:
        """Rows of both among the prepared channels."""
        return [COARSE.index(name) for name in self.coarse], [FINE.index(name) for name in self.fine]

    def _shown(self, names: Sequence[str]) -> tuple[str, ...]:
        hidden = {name for group in self.without for name in GROUPS[group]}
        return tuple(name for name in names if name not in hidden)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """Counts of fine pixels on the validation images at `THRESHOLDS` thresholds.

    Attributes:
        names: (N,) drive and camera of each image.
        true: (N, THRESHOLDS) moving pixels of at least so large a score; all of them by the first threshold, 0.
        false: (N, THRESHOLDS) static ones.
    """

    names: list[tuple[str, str]]
    true: NDArray[np.float64]
    false: NDArray[np.float64]

    @property
    def best(self) -> int:
        """Index of the threshold with the largest mean IoU of images in which something moves.

        Raises:
            UsageError: nothing moves in any of them.
        """
        if not self._moving.any():
            raise UsageError(f"validation: expected an image in which {LEAST_PX} px move, got none; hold out others")
        return int(np.argmax(self._image_iou().mean(0)))

    def _image_iou(self) -> NDArray[np.float64]:
        """(images in which something moves, THRESHOLDS)."""
        rows = self._moving
        return np.asarray(self.true[rows] / (self.true[:, :1] + self.false)[rows])

    @property
    def _moving(self) -> NDArray[np.bool_]:
        return np.asarray(self.true[:, 0] >= LEAST_PX)

    def summary(self) -> dict[str, Any]:
        """Scores at the best threshold, intervals by drive."""
        k, moving, all_moving = self.best, self._moving, self.true[:, 0]
        true, union = self.true[:, k], all_moving + self.false[:, k]
        of_image = self._image_iou()[:, k]
        drives = np.array([drive for drive, _ in self.names])
        return {
            "drives": len(set(drives)),
            "iou_of_images": round(float(of_image.mean()), 4),
            "iou_of_images_ci95": _by_drive(of_image, np.ones_like(of_image), drives[moving]),
            "iou": round(float(true.sum() / max(union.sum(), 1)), 4),
            "iou_ci95": _by_drive(true, union, drives),
            "precision": round(float(true.sum() / max((self.true + self.false)[:, k].sum(), 1)), 4),
            "recall": round(float(true.sum() / max(all_moving.sum(), 1)), 4),
            "false_positives": round(float(self.false[:, k].sum() / (all_moving + self.false[:, 0]).sum()), 5),
        }


def _by_drive(part: NDArray[np.float64], whole: NDArray[np.float64], drives: NDArray[np.str_]) -> list[float] | None:
    """Interval of a ratio, 95 %, by drive."""
    rows = [drives == drive for drive in sorted(set(drives))]
    interval = ratio_interval(np.array([part[row].sum() for row in rows]), np.array([whole[row].sum() for row in rows]))
    return None if interval is None else [round(end, 4) for end in interval]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Crops of a step.

    Attributes:
        images: (batch,) index of the image of each crop.
        coarse: (batch, C, rows, columns) uint8.
        fine: (batch, F, 2 rows, 2 columns) uint8.
        target: (batch, 2 rows, 2 columns) float32, share of moving pixels.
        weight: the same shape, float32; larger for small objects, 0 outside of the valid region.
    """

    images: NDArray[np.int64]
    coarse: Tensor
    fine: Tensor
    target: Tensor
    weight: Tensor


class Batches:
    """Crops of prepared drives, drawn and varied by a generator.

    Args:
        drives: prepared.
        plan: of the training.
    """

    def __init__(self, drives: Sequence[PreparedDrive], plan: Plan) -> None:
        self._images = [(drive, number) for drive in drives for number in range(drive.images)]
        self._plan = plan
        self._varied = [
            {kind: [row for row, name in enumerate(shown) if name in names] for kind, names in VARIED.items()}
            for shown in (plan.coarse, plan.fine)
        ]

    def __len__(self) -> int:
        return len(self._images) // self._plan.batch

    @property
    def images(self) -> int:
        """How many images there are to draw from."""
        return len(self._images)

    def epoch(self, epoch: int, losses: NDArray[np.float64]) -> Iterator[Batch]:
        """Batches of an epoch, the same for the same epoch and losses.

        Args:
            epoch: number.
            losses: (images,) of each image when it was last seen.
        """
        rng = np.random.default_rng([self._plan.seed, epoch])
        chances = 1 - HARD + HARD * losses / losses.mean()
        order = rng.choice(len(chances), len(self) * self._plan.batch, p=chances / chances.sum())
        for chosen in order.reshape(-1, self._plan.batch):
            crops = [self._crop(drive, number, rng) for drive, number in (self._images[index] for index in chosen)]
            coarse, fine, target, weight = (torch.from_numpy(np.stack(arrays)) for arrays in zip(*crops, strict=True))
            yield Batch(images=chosen, coarse=coarse, fine=fine, target=target, weight=weight)

    def _crop(self, drive: PreparedDrive, number: int, rng: np.random.Generator) -> tuple[NDArray[Any], ...]:
        coarse, fine = drive.coarse()[number], drive.fine()[number]
        v, u = self._corner(fine[-1], rng)
        rows, columns = self._plan.crop_px
        small = coarse[:, v : v + rows, u : u + columns]
        large = fine[:, 2 * v : 2 * (v + rows), 2 * u : 2 * (u + columns)]
        valid = valid_region(small)
        target = large[-1]
        weight = np.where(valid, small_weight(target), np.float32(0))
        parts = [size[rows] for size, rows in zip((small, large), self._plan.rows, strict=True)]
        mirror = rng.random() < 0.5
        if mirror:
            parts, target, weight = [part[:, :, ::-1].copy() for part in parts], target[:, ::-1], weight[:, ::-1]
        gain = rng.uniform(-1.25, 1.25) if rng.random() < STRANGE else rng.uniform(0.8, 1.25)
        shift = rng.uniform(-12, 12)
        strength, earlier = rng.uniform(0.7, 1.4), rng.random() >= WITHOUT_EARLIER
        for part, varied in zip(parts, self._varied, strict=True):
            if mirror:
                vary(part, varied["mirrored"], -1.0)
            vary(part, varied["grey"], gain, shift)
            vary(part, varied["differences"], strength)
            if not earlier:
                part[varied["earlier"]] = ZERO
        return *parts, target.astype(np.float32) / 255, np.ascontiguousarray(weight)

    def _corner(self, target: NDArray[np.uint8], rng: np.random.Generator) -> tuple[int, int]:
        spare = np.array(target.shape, dtype=np.int64) // 2 - self._plan.crop_px
        corner = rng.integers(0, spare + 1)
        if rng.random() < CROPS_ON_MOTION:
            count, _, _, middles = cv2.connectedComponentsWithStats((target > 127).astype(np.uint8))
            if count > 1:  # any of the objects, as often a small one as a large one
                middle = middles[rng.integers(1, count)][::-1] / 2
                corner = np.clip(middle.astype(np.int64) - rng.integers(0, self._plan.crop_px), 0, spare)
        return int(corner[0]), int(corner[1])


def small_weight(target: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Weight of each pixel, (H, W) float32: 1, and more on small objects, since each object counts as much as another.

    Args:
        target: (H, W) uint8, share of moving pixels; what touches is one object.
    """
    _, labels, boxes, _ = cv2.connectedComponentsWithStats((target > 127).astype(np.uint8))
    weights = np.clip(np.sqrt(SMALL_PX / np.maximum(boxes[:, cv2.CC_STAT_AREA], 1)), 1, SMALL_WEIGHT).astype(np.float32)
    weights[0] = 1
    return np.asarray(weights[labels])


def loss_of(logits: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """Cross-entropy of pixels, and what the soft IoU of moving pixels lacks of 1; (N,), of each crop.

    Args:
        logits: (N, H, W).
        target: (N, H, W) in [0, 1].
        weight: (N, H, W), 0 where nothing counts.
    """
    of_pixel = weight * (1 + (MOVING_WEIGHT - 1) * target)
    entropy = (binary_cross_entropy_with_logits(logits, target, reduction="none") * of_pixel).sum((1, 2))
    scores = torch.sigmoid(logits) * weight
    both = (scores * target).sum((1, 2))
    union = (scores + target * weight).sum((1, 2)) - both
    return 5 * entropy / (weight > 0).sum((1, 2)).clamp(min=1) + 1 - (both + SMOOTH_PX) / (union + SMOOTH_PX)


def validate(network: nn.Module, drives: Sequence[PreparedDrive], plan: Plan, device: str) -> Validation:
    """Count right and wrong pixels on whole images at every threshold."""
    coarse_rows, fine_rows = plan.rows
    edges = np.linspace(0, 1, THRESHOLDS + 1)
    network.eval()
    names: list[tuple[str, str]] = []
    counts: list[list[NDArray[np.int64]]] = []  # of moving, then of static pixels, by score
    for drive in drives:
        for coarse, fine in zip(drive.coarse(), drive.fine(), strict=True):
            height, width = fine.shape[1:]
            given = padded(Channels(coarse=coarse[coarse_rows], fine=fine[fine_rows]))
            with torch.no_grad():
                logits = network(*(torch.from_numpy(part[None]).to(device) for part in (given.coarse, given.fine)))
            scores = torch.sigmoid(logits)[0, :height, :width].cpu().numpy()
            moving, counted = fine[-1] > 127, valid_region(coarse)
            counts.append([np.histogram(scores[kind & counted], bins=edges)[0] for kind in (moving, ~moving)])
            names.append((drive.recording, drive.camera))
    above = np.array(counts, dtype=np.float64)[..., ::-1].cumsum(-1)[..., ::-1]  # at least a bin's lower edge
    return Validation(names=names, true=above[:, 0], false=above[:, 1])


def train(
    plan: Plan,
    training: Sequence[PreparedDrive],
    held_out: Sequence[PreparedDrive],
    out: Path,
    *,
    start: Path | None = None,
) -> tuple[nn.Module, Validation, list[dict[str, float]]]:
    """Train all epochs and keep the one that validates best; continues from the checkpoint in `out`.

    Args:
        plan: of the training.
        training: drives to learn from.
        held_out: drives that validate.
        out: folder of checkpoint and log.
        start: exported network whose weights to begin with, beside its card.

    Returns:
        The network with the best weights, its validation, and the log.

    Raises:
        UsageError: the checkpoint in `out` is of another plan or other data.
    """
    torch.manual_seed(plan.seed)
    torch.use_deterministic_algorithms(mode=True, warn_only=True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # nothing reads it; an eighth of the time
    device = "cuda" if torch.cuda.is_available() else "cpu"
    network = MotionNetwork(len(plan.coarse), len(plan.fine))
    batches = Batches(training, plan)
    if start is not None:
        crops = list(islice(batches.epoch(0, np.ones(batches.images)), STATISTICS_BATCHES))
        given = torch.cat([batch.coarse for batch in crops]), torch.cat([batch.fine for batch in crops])
        begin_with(network, start, {"coarse": plan.coarse, "fine": plan.fine}, given)
    network.to(device, memory_format=torch.channels_last)
    averaged = torch.optim.swa_utils.AveragedModel(network, avg_fn=_running_mean, use_buffers=True)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=plan.decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, plan.rate, total_steps=plan.epochs * len(batches), pct_start=WARM_UP
    )
    state: dict[str, Any] = {"epoch": 0, "best": -1.0, "weights": averaged.state_dict(), "log": []}
    state["losses"] = torch.ones(batches.images, dtype=torch.float64)  # of each image when it was last seen
    parts = {"network": network, "averaged": averaged, "optimiser": optimiser, "schedule": schedule}
    planned = {**asdict(plan), "images": batches.images}
    if (out / CHECKPOINT).is_file():
        checkpoint = torch.load(out / CHECKPOINT, map_location=device, weights_only=True)
        if (got := checkpoint["plan"]) != planned:
            raise UsageError(f"{out / CHECKPOINT}: expected the plan {planned}, got {got}; use a new --out")
        state = checkpoint["state"]
        state["losses"] = state["losses"].cpu()
        for name, part in parts.items():
            part.load_state_dict(checkpoint[name])
    for epoch in range(state["epoch"], plan.epochs):
        began, losses = time.monotonic(), state["losses"].clone()
        network.train()
        for batch in batches.epoch(epoch, state["losses"].numpy()):
            coarse, fine = (part.to(device, memory_format=torch.channels_last) for part in (batch.coarse, batch.fine))
            target, weight = batch.target.to(device), batch.weight.to(device)
            with torch.autocast(device, dtype=torch.bfloat16, enabled=plan.bfloat16):
                logits = network(coarse, fine)
            of_crop = loss_of(logits, target, weight)
            optimiser.zero_grad()
            of_crop.mean().backward()
            optimiser.step()
            schedule.step()
            averaged.update_parameters(network)
            losses[batch.images] = of_crop.detach().double().cpu()
        state["losses"] = losses
        found_now = validate(averaged, held_out, plan, device).summary()
        line = {
            "epoch": epoch + 1,
            "loss": float(losses.mean()),
            "seconds": time.monotonic() - began,
            **{name: found_now[name] for name in ("iou_of_images", "iou", "precision", "recall", "false_positives")},
        }
        state["log"].append(line)
        LOG.info(" ".join(f"{name}={value:.4g}" for name, value in line.items()))
        if found_now["iou_of_images"] > state["best"]:
            best_weights = {name: value.clone() for name, value in averaged.state_dict().items()}
            state |= {"best": found_now["iou_of_images"], "weights": best_weights}
        state["epoch"] = epoch + 1
        with replacing(out / CHECKPOINT) as file:
            held = {name: part.state_dict() for name, part in parts.items()}
            torch.save({"plan": planned, "state": state, **held}, file)
        write_log(out, state["log"])
    averaged.load_state_dict(state["weights"])
    best = averaged.module.to("cpu").eval()
    return best, validate(best, held_out, plan, "cpu"), state["log"]


def _running_mean(mean: Tensor, now: Tensor, steps: Tensor) -> Tensor:
    """Of weights; young means forget faster."""
    kept = min(AVERAGED, float((1 + steps) / (10 + steps)))
    return mean * kept + now * (1 - kept)


def write_log(out: Path, log: Sequence[dict[str, float]]) -> None:
    """Write `log.csv`: a line for each epoch."""
    write_text(out / "log.csv", pd.DataFrame(list(log)).to_csv(index=False, float_format="%.6g", lineterminator="\n"))


def export(
    network: nn.Module,
    plan: Plan,
    reached: Validation,
    log: Sequence[dict[str, float]],
    *,
    provenance: dict[str, Any],
    out: Path,
) -> None:
    """Write `learned.onnx` and its card `learned.json`."""
    rows, columns = plan.crop_px
    example = (
        torch.full((1, len(plan.coarse), rows, columns), ZERO, dtype=torch.uint8),
        torch.full((1, len(plan.fine), 2 * rows, 2 * columns), ZERO, dtype=torch.uint8),
    )
    size = {0: "n", 2: "h", 3: "w"}
    stream = io.BytesIO()
    torch.onnx.export(
        ScoredNetwork(network).eval().to(memory_format=torch.contiguous_format),
        example,
        stream,
        input_names=["coarse", "fine"],
        output_names=["scores"],
        dynamic_axes={
            "coarse": size,
            "fine": {axis: name if axis == 0 else f"2{name}" for axis, name in size.items()},
            "scores": {0: "n", 1: "2h", 2: "2w"},
        },
        opset_version=17,
        dynamo=False,
    )
    content = stream.getvalue()
    card = {
        "name": "learned",
        "sha256": hashlib.sha256(content).hexdigest(),
        "licence": "Apache-2.0",
        "coarse": list(plan.coarse),
        "fine": list(plan.fine),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        "threshold": reached.best / THRESHOLDS,
        "validation": reached.summary(),
        "training": {
            **asdict(plan),
            "epochs_trained": len(log),
            "minutes": round(sum(line["seconds"] for line in log) / 60, 1),
            **provenance,
        },
    }
    write_bytes(out / "learned.onnx", content)
    write_text(out / "learned.json", json.dumps(card, indent=2) + "\n")


def main(
    out: Annotated[Path, typer.Option(help="folder of weights, log and checkpoint")],
    dataset: Annotated[str, typer.Option(help="rendered data set, by name or card")] = DATASET,
    epochs: Annotated[int, typer.Option(min=1, help="passes over the training images")] = 20,
    bfloat16: Annotated[bool, typer.Option(help="compute in 16 bits")] = False,
    rate: Annotated[float, typer.Option(min=0.0, help="largest learning rate")] = 3e-3,
    start: Annotated[
        Path | None, typer.Option(help="learned.onnx, beside its card, whose weights to begin with")
    ] = None,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    workers: Annotated[
        int, typer.Option(min=1, help="processes that render and prepare; threads that train")
    ] = usable_cores(),
    cache: Annotated[Path | None, typer.Option(help="folder of prepared inputs; OUT/inputs without")] = None,
) -> None:
    """Train the network of the method `learned`."""
    plan = Plan(
        epochs=epochs,
        rate=rate,
        bfloat16=bfloat16,
        start="" if start is None else hashlib.sha256(start.read_bytes()).hexdigest(),
        seed=seed,
    )
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    make_folder(out)

    def progress(done: int, total: int) -> None:
        if done == total or done % 50 == 0:
            LOG.info("inputs of %d of %d drives", done, total)

    held = cache or out / "inputs"
    training, held_out = (
        prepare(dataset, part, held, disturbed=plan.disturbed, workers=workers, progress=progress)
        for part in ("training", "validation")
    )
    torch.set_num_threads(workers)
    device = torch.cuda.get_device_name() if torch.cuda.is_available() else f"processor, {workers} threads"
    LOG.info("trains on: %s", device)
    network, reached, log = train(plan, training, held_out, out, start=start)
    scenario = load_card(dataset).scenario
    provenance = {
        "dataset": dataset,
        "scenario_sha256": None if scenario is None else hashlib.sha256(scenario.read_bytes()).hexdigest(),
        "drives": len({drive.recording for drive in training}),
        "images": sum(drive.images for drive in training),
        "device": device,
        "torch": torch.__version__.split("+")[0],
        "fisheye_bench": __version__,
    }
    export(network, plan, reached, log, provenance=provenance, out=out)
    LOG.info(json.dumps(reached.summary()))


if __name__ == "__main__":
    typer.run(main)
