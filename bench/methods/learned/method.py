"""The method `learned`: the network on ONNX Runtime, from the last images to scores of cells."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bench.errors import DataError, UsageError
from bench.methods.contract import Method, MethodInput
from bench.methods.learned.inputs import BACK, COARSE, FINE, ZERO, Channels, network_input
from bench.methods.rigid_scene.scene import Views, resized
from bench.recordings.validation import read_json
from bench.records.segmentation import Segmentation

try:
    import onnxruntime
except ImportError:
    onnxruntime = None  # told when the method is built

SHIPPED = Path(__file__).with_name("learned.onnx")
MULTIPLE_PX = 32  # the network takes fine images whose sides are multiples of it, and coarse ones of half of that
INSTALL = "pip install 'fisheye-bench[learned]'"


class NetworkCard(BaseModel):
    """The JSON file beside a trained network; of its other keys nothing is read.

    Attributes:
        coarse: names of the channels that it takes, in this order.
        fine: the same of those of the size of the answer.
        threshold: score above which a cell moves: the best on the validation drives.
        sha256: of the ONNX file, hexadecimal.
    """

    model_config = ConfigDict(frozen=True)

    coarse: tuple[str, ...]
    fine: tuple[str, ...]
    threshold: float
    sha256: str


def read_card(file: Path) -> NetworkCard:
    """Read the card of an ONNX file and make sure that the file is the one that it describes.

    Raises:
        DataError: one of the files is missing, damaged or not of this kind.
    """
    card_file = file.with_suffix(".json")
    card = read_json(NetworkCard, card_file)
    try:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise DataError(file, expected="the network of its card", got=str(error.strerror)) from error
    if digest != card.sha256:
        expected = f"sha256 {card.sha256}, as {card_file.name} says"
        raise DataError(file, expected=expected, got=digest, hint="restore both files")
    for field, names, known in (("coarse", card.coarse, COARSE), ("fine", card.fine, FINE)):
        if unknown := set(names) - set(known):
            got = ", ".join(sorted(unknown))
            raise DataError(card_file, field=field, expected="channels of this version", got=got)
    return card


@dataclass(frozen=True, kw_only=True)
class LearnedMethod(Method):
    """A small encoder-decoder on the last images and what geometry knows of them, trained on rendered drives.

    Attributes:
        weights: ONNX file, with its card beside it; empty for the one in the package.
        threshold: score above which a cell moves; None for the card's.

    Raises:
        UsageError: ONNX Runtime is not installed.
        DataError: weights that cannot be used.

    Source:
        The task and the two-stream idea are those of Yahiaoui et al. 2019, FisheyeMODNet; the network is our own.
    """

    name = "learned"
    longest_history = BACK

    weights: str = ""
    threshold: Annotated[float, Field(ge=0, lt=1)] | None = None

    def __post_init__(self) -> None:
        if onnxruntime is None:
            raise UsageError(f"learned: expected ONNX Runtime, which runs the network; install it: {INSTALL}")
        self.trained  # noqa: B018 - errors in the files are told when the method is built

    @property
    def files(self) -> tuple[Path, Path]:  # type: ignore[override]
        """The network and its card."""
        file = Path(self.weights) if self.weights else SHIPPED
        return file, file.with_suffix(".json")

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`."""
        views, trained = Views.of(frame), self.trained
        valid = resized(frame.valid.astype(np.uint8) * 255, views.fine[-1].shape[::-1]) > 250
        scores = self.scores(network_input(views, trained.coarse, trained.fine))
        scores = np.where(valid, scores, np.float32(0))
        threshold = trained.threshold if self.threshold is None else self.threshold
        return Segmentation(
            cell_size_px=views.cell_size_px,
            mask=scores > threshold,
            likelihood=scores,
            undefined=~valid,
            likelihood_is_score=True,
            threshold=threshold,
        )

    def scores(self, channels: Channels) -> NDArray[np.float32]:
        """Run the network; (H, W) float32 in [0, 1], at the size of the fine channels."""
        height, width = channels.fine.shape[1:]
        whole = padded(channels)
        session = _session(self.files[0], self.trained.sha256)
        (scores,) = session.run(None, {"coarse": whole.coarse[None], "fine": whole.fine[None]})
        # ONNX Runtime's sigmoid can be above 1 by a rounding.
        return np.asarray(np.clip(scores[0, :height, :width], 0, 1), dtype=np.float32)

    @cached_property
    def trained(self) -> NetworkCard:
        """The network's card: what it is shown, and its threshold."""
        return read_card(self.files[0])


def padded(channels: Channels) -> Channels:
    """Channels of sides that the network takes: zeros are added below and on the right."""
    height, width = (side + -side % MULTIPLE_PX for side in channels.fine.shape[1:])
    sizes = ((channels.coarse, height // 2, width // 2), (channels.fine, height, width))
    coarse, fine = (
        np.pad(part, ((0, 0), (0, rows - part.shape[1]), (0, columns - part.shape[2])), constant_values=ZERO)
        for part, rows, columns in sizes
    )
    return Channels(coarse=coarse, fine=fine)


@lru_cache(maxsize=1)  # copies of the method for units of work share it
def _session(file: Path, _: str) -> Any:
    """The network of a file with this digest, in one thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime raises its own kinds for damaged files
        raise DataError(file, expected="an ONNX network", got=str(error).splitlines()[0]) from error
