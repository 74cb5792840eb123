"""The method `learned`: the network on ONNX Runtime, from a pair of images to scores of cells."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, UsageError
from bench.methods.contract import Method, MethodInput
from bench.methods.learned.inputs import ALL_CHANNELS, ZERO, Bytes, network_input, working_pair
from bench.records.segmentation import Segmentation

try:
    import onnxruntime
except ImportError:
    onnxruntime = None  # told when the method is built

SHIPPED = Path(__file__).with_name("learned.onnx")
MULTIPLE_PX = 16  # the network takes images whose sides are multiples of it
INSTALL = "pip install 'fisheye-bench[learned]'"


@dataclass(frozen=True, slots=True, kw_only=True)
class Weights:
    """A trained network as its card, the JSON file of the same name, describes it.

    Attributes:
        file: the ONNX file.
        channels: that it takes, in this order.
        threshold: score above which a cell moves: the best on the validation drives.
        sha256: of the ONNX file, hexadecimal.
    """

    file: Path
    channels: tuple[str, ...]
    threshold: float
    sha256: str

    @classmethod
    def read(cls, file: Path) -> Weights:
        """Read the card of an ONNX file and make sure that the file is the one that it describes.

        Raises:
            DataError: one of the files is missing, damaged or not of this kind.
        """
        card = file.with_suffix(".json")
        try:
            content = json.loads(card.read_text(encoding="utf-8"))
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            channels, threshold = tuple(content["channels"]), float(content["threshold"])
            expected = content["sha256"]
        except OSError as error:
            raise DataError(
                error.filename or file, expected="a network and its card", got=str(error.strerror)
            ) from error
        except (ValueError, KeyError, TypeError) as error:
            hint = "export it with python -m bench.training.train"
            raise DataError(card, expected="the card of a network", got=repr(error), hint=hint) from error
        if digest != expected:
            raise DataError(
                file, expected=f"sha256 {expected}, as {card.name} says", got=digest, hint="restore both files"
            )
        if unknown := [name for name in channels if name not in ALL_CHANNELS]:
            raise DataError(card, field="channels", expected="channels of this version", got=", ".join(unknown))
        return cls(file=file, channels=channels, threshold=threshold, sha256=digest)


@dataclass(frozen=True, kw_only=True)
class LearnedMethod(Method):
    """A small encoder-decoder on two images and what geometry knows of them, trained on rendered drives.

    Attributes:
        weights: ONNX file, with its card beside it; empty for the one in the package.
        threshold: score above which a cell moves; None for the card's.

    Raises:
        UsageError: ONNX Runtime is not installed, or a threshold that is no score.
        DataError: weights that cannot be used.

    Source:
        The task and the two-stream idea are those of Yahiaoui et al. 2019, FisheyeMODNet; the network is our own.
    """

    name = "learned"

    weights: str = ""
    threshold: float | None = None

    def __post_init__(self) -> None:
        if self.threshold is not None and not 0 <= self.threshold < 1:
            raise UsageError(f"learned: threshold: expected a number in [0, 1), got {self.threshold}")
        if onnxruntime is None:
            raise UsageError(f"learned: expected ONNX Runtime, which runs the network; install it: {INSTALL}")
        self._trained  # noqa: B018 - errors in the files are told when the method is built

    @property
    def files(self) -> tuple[Path, Path]:  # type: ignore[override]
        """The network and its card."""
        file = Path(self.weights) if self.weights else SHIPPED
        return file, file.with_suffix(".json")

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of what the network sees; see `bench.methods.learned.inputs`."""
        return self._trained.channels

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`.

        Raises:
            UnansweredImage: the network asks for geometry, and there is no ego-motion.
        """
        pair = working_pair(frame)
        scores = np.where(pair.valid, self.scores(network_input(pair, self.channels)), np.float32(0))
        threshold = self._trained.threshold if self.threshold is None else self.threshold
        return Segmentation(
            cell_size_px=pair.cell_size_px,
            mask=scores > threshold,
            likelihood=scores,
            undefined=~pair.valid,
            likelihood_is_score=True,
            threshold=threshold,
        )

    def scores(self, channels: Bytes) -> NDArray[np.float32]:
        """Run the network: (C, h, w) uint8 -> (h, w) float32 in [0, 1]."""
        _, height, width = channels.shape
        below, right = -height % MULTIPLE_PX, -width % MULTIPLE_PX
        padded = np.pad(channels, ((0, 0), (0, below), (0, right)), constant_values=ZERO)
        (found,) = self._session.run(None, {"channels": padded[None]})
        return np.asarray(found[0, :height, :width], dtype=np.float32)

    @cached_property
    def _trained(self) -> Weights:
        return Weights.read(self.files[0])

    @property
    def _session(self) -> Any:
        return _session(self._trained.file, self._trained.sha256)

    def __getstate__(self) -> dict[str, object]:
        return self.settings()  # a session cannot travel to other processes; they open their own

    def __setstate__(self, settings: dict[str, object]) -> None:
        self.__dict__.update(settings)


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
