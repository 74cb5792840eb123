"""Train the network of the method `learned`: `python -m bench.training.train --out DIR` (extra `train`).

The data are rendered and the network's inputs prepared where that is missing; both continue where they were
interrupted, and so does the training, from the last whole epoch. Everything random follows from the seed.
`DIR` then holds `learned.onnx` and its card `learned.json`, `log.csv` and `curves.png`. To score what was trained:
`fisheye-bench run demo --method learned --set weights=DIR/learned.onnx`.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import matplotlib as mpl
import numpy as np
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
from bench.methods.learned.inputs import ALL_CHANNELS, CHANNELS, INPUT_SETS, MIRRORED, ZERO, InputSet
from bench.methods.learned.method import MULTIPLE_PX
from bench.recordings import load_card
from bench.training.network import MotionNetwork, ScoredNetwork
from bench.training.pairs import DATASET
from bench.training.prepared import PreparedDrive, prepare

LOG = logging.getLogger(__name__)
CROP_PX = (192, 256)  # rows, columns; the smallest image of the training data
CROPS_ON_MOTION = 0.5  # share of the crops that are put around something that moves, where anything does
AVERAGED = 0.998  # of the running mean of the weights, which is what is validated and exported
WARM_UP = 0.05  # of all steps
MOVING_WEIGHT = 2.0  # of moving cells in the cross-entropy; static ones are fifty times as many
THRESHOLDS = 100  # that validation tries
CHECKPOINT = "checkpoint.pt"
GREY = ("current", "previous", "rotated", "on_road")
DIFFERENCES = ("difference", "rotated_difference", "road_difference", "flow_difference")


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Everything that decides the weights, beside the data.

    Attributes:
        inputs: what the network sees, see `bench.methods.learned.inputs`.
        epochs: at most.
        patience: epochs without a better validation after which training stops.
        batch: crops of a step.
        rate: largest learning rate.
        decay: of the weights.
        seed: of everything random.
    """

    inputs: InputSet = "likelihood"
    epochs: int = 14
    patience: int = 5
    batch: int = 8
    rate: float = 3e-3
    decay: float = 1e-2
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """Counts on the validation drives at `THRESHOLDS` thresholds.

    Attributes:
        names: (D,) drive and camera of each row.
        true, false, missed: (D, THRESHOLDS) cells.
        cells: (D,) cells that count.
    """

    names: list[tuple[str, str]]
    true: NDArray[np.float64]
    false: NDArray[np.float64]
    missed: NDArray[np.float64]
    cells: NDArray[np.float64]

    @property
    def best(self) -> int:
        """Index of the threshold with the largest IoU over all cells."""
        return int(np.argmax(self._iou(slice(None))))

    def _iou(self, rows: Any) -> NDArray[np.float64]:
        true, wrong = self.true[rows].sum(0), self.false[rows].sum(0) + self.missed[rows].sum(0)
        return np.asarray(true / np.maximum(true + wrong, 1))

    def summary(self) -> dict[str, Any]:
        """Scores at the best threshold, the interval by drive."""
        k = self.best
        drives = sorted({name for name, _ in self.names})
        rows = [np.array([name == drive for name, _ in self.names]) for drive in drives]
        true = np.array([self.true[row, k].sum() for row in rows])
        union = true + np.array([self.false[row, k].sum() + self.missed[row, k].sum() for row in rows])
        of_camera = {
            camera: round(float(self._iou([c == camera for _, c in self.names])[k]), 4)
            for camera in dict.fromkeys(camera for _, camera in self.names)
        }
        interval = ratio_interval(true, union)
        return {
            "drives": len(drives),
            "iou": round(float(self._iou(slice(None))[k]), 4),
            "iou_ci95": None if interval is None else [round(end, 4) for end in interval],
            "iou_by_camera": of_camera,
            "precision": round(float(self.true[:, k].sum() / max((self.true + self.false)[:, k].sum(), 1)), 4),
            "recall": round(float(self.true[:, k].sum() / max((self.true + self.missed)[:, k].sum(), 1)), 4),
            "false_positives": round(float(self.false[:, k].sum() / self.cells.sum()), 5),
        }


class Batches:
    """Crops of prepared drives, drawn and varied by a generator.

    Args:
        drives: prepared.
        channels: that the network sees.
        plan: of the training.
    """

    def __init__(self, drives: Sequence[PreparedDrive], channels: Sequence[str], plan: Plan) -> None:
        self._pairs = [(drive, number) for drive in drives for number in range(drive.pairs)]
        self._rows = [ALL_CHANNELS.index(name) for name in channels] + [len(ALL_CHANNELS)]
        self._mirrored = [k for k, name in enumerate(channels) if name in MIRRORED]
        self._grey = [k for k, name in enumerate(channels) if name in GREY]
        self._differences = [k for k, name in enumerate(channels) if name in DIFFERENCES]
        self._plan = plan

    def __len__(self) -> int:
        return len(self._pairs) // self._plan.batch

    def epoch(self, epoch: int) -> Iterator[Tensor]:
        """Batches of an epoch, (batch, channels + 1, rows, columns) uint8; the same for the same epoch."""
        rng = np.random.default_rng([self._plan.seed, epoch])
        order = rng.permutation(len(self._pairs))[: len(self) * self._plan.batch]
        for chosen in order.reshape(-1, self._plan.batch):
            pairs = [self._pairs[index] for index in chosen]
            yield torch.from_numpy(np.stack([self._crop(drive, number, rng) for drive, number in pairs]))

    def _crop(self, drive: PreparedDrive, number: int, rng: np.random.Generator) -> NDArray[np.uint8]:
        arrays = drive.arrays()[number]
        v, u = self._corner(arrays[-1], rng)
        crop = arrays[:, v : v + CROP_PX[0], u : u + CROP_PX[1]][self._rows]
        if rng.random() < 0.5:
            crop = crop[:, :, ::-1].copy()
            mirrored = 2 * ZERO - crop[self._mirrored].astype(np.int16)
            crop[self._mirrored] = np.clip(mirrored, 0, 255)
        gain, shift = rng.uniform(0.8, 1.25), rng.uniform(-12, 12)
        self._vary(crop, self._grey, gain, shift)
        self._vary(crop, self._differences, rng.uniform(0.7, 1.4), 0.0)
        return np.ascontiguousarray(crop)

    def _corner(self, target: NDArray[np.uint8], rng: np.random.Generator) -> tuple[int, int]:
        spare = np.array(target.shape, dtype=np.int64) - CROP_PX
        corner = rng.integers(0, spare + 1)
        moving = np.flatnonzero(target > 127)
        if len(moving) and rng.random() < CROPS_ON_MOTION:
            middle = np.array(divmod(int(rng.choice(moving)), target.shape[1]))
            corner = np.clip(middle - rng.integers(0, CROP_PX), 0, spare)
        return int(corner[0]), int(corner[1])

    def _vary(self, crop: NDArray[np.uint8], rows: list[int], gain: float, shift: float) -> None:
        varied = (crop[rows].astype(np.float32) - ZERO) * gain + ZERO + shift
        crop[rows] = np.clip(np.rint(varied), 0, 255).astype(np.uint8)


def loss_of(logits: Tensor, target: Tensor, valid: Tensor) -> Tensor:
    """Cross-entropy of cells, and what the soft IoU of all moving cells lacks of 1.

    Args:
        logits: (N, h, w).
        target: (N, h, w) in [0, 1].
        valid: (N, h, w) in {0, 1}.
    """
    weight = valid * (1 + (MOVING_WEIGHT - 1) * target)
    entropy = (binary_cross_entropy_with_logits(logits, target, reduction="none") * weight).sum() / valid.sum()
    scores = torch.sigmoid(logits) * valid
    both = (scores * target).sum()
    return 5 * entropy + 1 - (both + 1) / ((scores + target * valid).sum() - both + 1)


def validate(network: nn.Module, drives: Sequence[PreparedDrive], channels: Sequence[str], device: str) -> Validation:
    """Count right and wrong cells on whole images at every threshold."""
    rows, valid_row = [ALL_CHANNELS.index(name) for name in channels], ALL_CHANNELS.index("valid")
    edges = np.linspace(0, 1, THRESHOLDS + 1)
    network.eval()
    moving, static = np.zeros((2, len(drives), THRESHOLDS))
    for index, drive in enumerate(drives):
        arrays = np.array(drive.arrays())
        height, width = arrays.shape[2:]
        sides = ((0, 0), (0, 0), (0, -height % MULTIPLE_PX), (0, -width % MULTIPLE_PX))
        given = torch.from_numpy(np.pad(arrays[:, rows], sides, constant_values=ZERO)).to(device)
        with torch.no_grad():
            scores = torch.sigmoid(network(given))[:, :height, :width].cpu().numpy()
        counted = arrays[:, valid_row] > ZERO
        for sums, chosen in ((moving, arrays[:, -1] > 127), (static, arrays[:, -1] <= 127)):
            sums[index] = np.histogram(scores[chosen & counted], bins=edges)[0]
    above = [sums[:, ::-1].cumsum(1)[:, ::-1] for sums in (moving, static)]  # at least the lower edge of each bin
    return Validation(
        names=[(drive.recording, drive.camera) for drive in drives],
        true=above[0],
        false=above[1],
        missed=moving.sum(1, keepdims=True) - above[0],
        cells=(moving + static).sum(1),
    )


def train(
    plan: Plan, training: Sequence[PreparedDrive], held_out: Sequence[PreparedDrive], out: Path
) -> tuple[nn.Module, Validation, list[dict[str, float]]]:
    """Train until validation no longer gets better; continues from the checkpoint in `out`.

    Returns:
        The network with the best weights, its validation, and the log.

    Raises:
        UsageError: the checkpoint in `out` is of another plan.
    """
    torch.manual_seed(plan.seed)
    torch.use_deterministic_algorithms(mode=True, warn_only=True)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    channels = CHANNELS[plan.inputs]
    network = MotionNetwork(len(channels)).to(device, memory_format=torch.channels_last)
    averaged = torch.optim.swa_utils.AveragedModel(network, avg_fn=_running_mean, use_buffers=True)
    batches = Batches(training, channels, plan)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=plan.decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, plan.rate, total_steps=plan.epochs * len(batches), pct_start=WARM_UP
    )
    state: dict[str, Any] = {"epoch": 0, "best": -1.0, "best_epoch": 0, "weights": averaged.state_dict(), "log": []}
    parts = {"network": network, "averaged": averaged, "optimiser": optimiser, "schedule": schedule}
    if (out / CHECKPOINT).is_file():
        found = torch.load(out / CHECKPOINT, map_location=device, weights_only=True)
        if found["plan"] != asdict(plan):
            raise UsageError(
                f"{out / CHECKPOINT}: expected the plan {asdict(plan)}, got {found['plan']}; use a new --out"
            )
        state = found["state"]
        for name, part in parts.items():
            part.load_state_dict(found[name])
    valid_row = channels.index("valid")
    for epoch in range(state["epoch"], plan.epochs):
        if epoch - state["best_epoch"] > plan.patience:
            break
        began, losses = time.monotonic(), []
        network.train()
        for batch in batches.epoch(epoch):
            given = batch.to(device)
            valid = (given[:, valid_row] > ZERO).float()
            loss = loss_of(network(given[:, :-1]), given[:, -1].float() / 255, valid)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            averaged.update_parameters(network)
            losses.append(loss.item())
        found_now = validate(averaged, held_out, channels, device).summary()
        line = {
            "epoch": epoch + 1,
            "loss": float(np.mean(losses)),
            "seconds": time.monotonic() - began,
            **{name: found_now[name] for name in ("iou", "precision", "recall", "false_positives")},
        }
        state["log"].append(line)
        LOG.info(" ".join(f"{name}={value:.4g}" for name, value in line.items()))
        if found_now["iou"] > state["best"]:
            best_weights = {name: value.clone() for name, value in averaged.state_dict().items()}
            state |= {"best": found_now["iou"], "best_epoch": epoch + 1, "weights": best_weights}
        state["epoch"] = epoch + 1
        with replacing(out / CHECKPOINT) as file:
            held = {name: part.state_dict() for name, part in parts.items()}
            torch.save({"plan": asdict(plan), "state": state, **held}, file)
        write_log(out, state["log"])
    averaged.load_state_dict(state["weights"])
    best = averaged.module.to("cpu").eval()
    return best, validate(best, held_out, channels, "cpu"), state["log"]


def _running_mean(mean: Tensor, now: Tensor, steps: Tensor) -> Tensor:
    """Of weights; young means forget faster."""
    kept = min(AVERAGED, float((1 + steps) / (10 + steps)))
    return mean * kept + now * (1 - kept)


def write_log(out: Path, log: Sequence[dict[str, float]]) -> None:
    """Write `log.csv` and `curves.png`."""
    text = io.StringIO()
    table = csv.DictWriter(text, fieldnames=list(log[0]), lineterminator="\n")
    table.writeheader()
    table.writerows({name: f"{value:.6g}" for name, value in line.items()} for line in log)
    write_text(out / "log.csv", text.getvalue())
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    epochs = [line["epoch"] for line in log]
    left.plot(epochs, [line["loss"] for line in log])
    left.set(xlabel="epoch", ylabel="loss on training drives")
    for name in ("iou", "precision", "recall"):
        right.plot(epochs, [100 * line[name] for line in log], label=name if name != "iou" else "IoU")
    right.set(xlabel="epoch", ylabel="validation drives, cells, %", ylim=(0, 100))
    right.legend()
    with replacing(out / "curves.png") as file:
        figure.savefig(file, dpi=110, format="png")
    plt.close(figure)


def export(
    network: nn.Module,
    plan: Plan,
    found: Validation,
    log: Sequence[dict[str, float]],
    *,
    provenance: dict[str, Any],
    out: Path,
) -> None:
    """Write `learned.onnx` and its card `learned.json`."""
    channels = CHANNELS[plan.inputs]
    example = torch.full((1, len(channels), *CROP_PX), ZERO, dtype=torch.uint8)
    stream = io.BytesIO()
    torch.onnx.export(
        ScoredNetwork(network).eval().to(memory_format=torch.contiguous_format),
        (example,),
        stream,
        input_names=["channels"],
        output_names=["scores"],
        dynamic_axes={"channels": {0: "n", 2: "h", 3: "w"}, "scores": {0: "n", 1: "h", 2: "w"}},
        opset_version=17,
        dynamo=False,
    )
    content = stream.getvalue()
    card = {
        "name": "learned",
        "sha256": hashlib.sha256(content).hexdigest(),
        "licence": "Apache-2.0",
        "channels": list(channels),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        "threshold": found.best / THRESHOLDS,
        "validation": found.summary(),
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
    inputs: Annotated[str, typer.Option(help=", ".join(INPUT_SETS))] = "likelihood",
    epochs: Annotated[int, typer.Option(min=1)] = 14,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    workers: Annotated[int, typer.Option(min=1, help="processes that render and prepare; threads that train")] = 0,
    cache: Annotated[Path | None, typer.Option(help="folder of prepared inputs; OUT/inputs without")] = None,
) -> None:
    """Train the network of the method `learned`."""
    if inputs not in CHANNELS:
        raise UsageError(f"--inputs: expected one of {', '.join(INPUT_SETS)}, got {inputs!r}")
    plan = Plan(inputs=inputs, epochs=epochs, seed=seed)
    workers = workers or usable_cores()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    make_folder(out)

    def progress(done: int, total: int) -> None:
        if done == total or done % 50 == 0:
            LOG.info("inputs of %d of %d drives", done, total)

    held = cache or out / "inputs"
    training = prepare(dataset, "training", held, workers=workers, progress=progress)
    held_out = prepare(dataset, "validation", held, workers=workers, progress=progress)
    torch.set_num_threads(workers)
    network, found, log = train(plan, training, held_out, out)
    scenario = load_card(dataset).scenario
    provenance = {
        "dataset": dataset,
        "scenario_sha256": None if scenario is None else hashlib.sha256(scenario.read_bytes()).hexdigest(),
        "drives": len({drive.recording for drive in training}),
        "pairs": sum(drive.pairs for drive in training),
        "torch": torch.__version__.split("+")[0],
        "fisheye_bench": __version__,
    }
    export(network, plan, found, log, provenance=provenance, out=out)
    LOG.info(json.dumps(found.summary()))


if __name__ == "__main__":
    typer.run(main)
