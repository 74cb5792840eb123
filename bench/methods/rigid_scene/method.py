"""The method, from two or more images to a mask of the current one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import ray_grid
from bench.flow.dense import DisFlow, FarnebackFlow, dense_flow
from bench.methods.contract import FlowMethod, MethodInput
from bench.methods.rigid_scene.candidates import Candidates, ObjectSettings, find_candidates
from bench.methods.rigid_scene.evidence import Evidence, EvidenceSettings, gather_evidence
from bench.methods.rigid_scene.motion import MotionAccuracy, correspondences, refine_motion
from bench.methods.rigid_scene.outlines import Pair, draw_objects
from bench.methods.rigid_scene.scene import GuidedFlow, RigidScene, Views, fine_cell_px, guided_flow, spread, warp
from bench.methods.settings import Positive, set_groups
from bench.records.segmentation import Segmentation

FLOW_PARAMETERS: dict[str, dict[str, object]] = {"dis": {"preset": "fast", "finest_scale": 0}}
KNOWN_SHARE = 0.2  # a region of the long pair that the short one covers by so much is nothing new
CAUSES = ("epipolar", "positive_depth", "positive_height", "floating")
STATIC_CAUSE = "static_camera"


@dataclass(frozen=True, kw_only=True)
class RigidSceneMethod(EvidenceSettings, FlowMethod):
    """Objects that no rigid scene explains, by flow, grey values and what stands on the road.

    Attributes:
        first_guess: flow starts from the motion of road and horizon; else from none.
        refine_motion: the recorded motion is corrected by the images.
        own_effects: a region through which the road is seen to move is the ego vehicle's own shadow or light; by three
            images.
        long_baseline: slow objects are also looked for in a pair of images that are further apart, where there is one.
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`; it works on half the size.
        flow_parameters: what the flow takes; without any, "dis" is fast and matches up to its image's own size.
        accuracy: of the recorded motion.
        objects: thresholds, growth and outlines.
        slow_px: the long pair adds what deviates by less, at half the size; faster objects have changed too much.

    Source:
        Mariotti and Eising for the constraints; the modules name what else they build on.
    """

    name = "rigid-scene"
    blind_at_epipole = False
    longest_history = 3

    first_guess: bool = True
    refine_motion: bool = True
    own_effects: bool = True
    long_baseline: bool = True
    flow: str = "dis"
    flow_parameters: dict[str, object] = field(default_factory=dict)
    accuracy: MotionAccuracy = field(default_factory=MotionAccuracy)
    objects: ObjectSettings = field(default_factory=ObjectSettings)
    slow_px: Positive = 2.0

    def __post_init__(self) -> None:
        set_groups(self, accuracy=MotionAccuracy(), objects=ObjectSettings())
        self._dense_flow()

    def _dense_flow(self) -> FarnebackFlow | DisFlow:
        return dense_flow(self.flow, **(self.flow_parameters or FLOW_PARAMETERS.get(self.flow, {})))

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`."""
        return self.segment_flow(frame, None)

    def segment_flow(self, frame: MethodInput, flow: NDArray[np.float32] | None) -> Segmentation:
        """Segment the current image with a flow of the last pair; the flow of images further apart is its own."""
        views = Views.of(frame)
        given, shape = views.given, views.given.valid.shape
        if flow is not None:
            flow = _flow_at(flow, shape, size=shape, was=frame.valid.shape)
        short = self.evidence(given, flow=flow)
        three = given.images[-3:] if self.own_effects and short.moves and len(given.images) > 2 else None
        candidates = find_candidates(short, self.objects, images=three)
        pairs = [Pair(previous=views.fine[-2], evidence=short)]
        back = min(self.longest_history, len(frame.images) - 1)
        if self.long_baseline and back > 1 and short.moves:
            long = self.evidence(given, back=back, known=short.scene)
            pairs.append(Pair(previous=views.fine[-1 - back], evidence=long))
        mask = self._drawn(candidates, views, pairs)
        for pair in pairs[1:]:
            slow = find_candidates(pair.evidence, self.objects, slow_px=self.slow_px)
            mask |= self._drawn(_not_yet_known(slow, mask), views, pairs[::-1])
        valid = spread(frame.valid, mask.shape)
        return Segmentation(
            cell_size_px=views.cell_size_px,
            mask=mask & valid,
            undefined=spread(short.edge, mask.shape) | ~valid,
            causes=CAUSES if short.moves else (STATIC_CAUSE,),
            cause=spread(_cause(short, candidates), mask.shape),
            parts=_parts(short, mask.shape),
        )

    def flow_cell_px(self, width: int) -> int:
        """Side of the cells on which it takes flow, px, for images of this width."""
        return 2 * fine_cell_px(width)

    def mean_flow(self, frame: MethodInput) -> NDArray[np.float32]:
        """Its own flow from the current to the previous image, (rows, columns, 2) float32, px of the given images."""
        given = Views.of(frame).given
        guided = self._guided_flow(given, 1, RigidScene.of(given))
        grid = ray_grid(frame.camera, self.flow_cell_px(frame.camera.width)).valid.shape
        return _flow_at(guided.flow, grid, size=frame.valid.shape, was=given.valid.shape)

    def evidence(
        self,
        given: MethodInput,
        *,
        back: int = 1,
        known: RigidScene | None = None,
        flow: NDArray[np.float32] | None = None,
    ) -> Evidence:
        """Evidence of the current image and the one `back` before it.

        Args:
            given: images, lens, times and motion at the size at which all is computed, of `Views`.
            back: how many images.
            known: the scene of the last pair, whose motion is better than the recorded one; None if it is not known.
            flow: (h, w, 2) float32, px, in place of the estimated one where it is finite; None for none.
        """
        current, previous = given.images[-1], given.images[-1 - back]
        scene = RigidScene.of(given, back=back, known=known)
        guided = self._guided_flow(given, back, scene)
        if flow is not None:
            guided = replace(guided, flow=np.where(np.isfinite(flow), flow, guided.flow))
        if self.refine_motion:
            seconds = (given.timestamps_ns[-1] - given.timestamps_ns[-1 - back]) / 1e9
            seen = correspondences(guided, current, given.camera)
            scene = refine_motion(scene, seen, seconds=seconds, accuracy=self.accuracy)
        guess, warped, neutral = warp(current, previous, valid=given.valid, scene=scene)
        guided = replace(guided, guess=guess, warped=warped, neutral=neutral | guided.neutral)
        return gather_evidence(current, previous, guided, scene, self)

    def _guided_flow(self, given: MethodInput, back: int, scene: RigidScene) -> GuidedFlow:
        return guided_flow(
            given.images[-1],
            given.images[-1 - back],
            valid=given.valid,
            scene=scene if self.first_guess else None,
            flow=self._dense_flow(),
        )

    def _drawn(self, candidates: Candidates, views: Views, pairs: Sequence[Pair]) -> NDArray[np.bool_]:
        return draw_objects(candidates, views.fine[-1], pairs, self.objects, floor_px=self.floor_px)


def _flow_at(
    flow: NDArray[np.float32], grid: tuple[int, ...], *, size: tuple[int, ...], was: tuple[int, ...]
) -> NDArray[np.float32]:
    """Flow on another grid of the image, nearest, in pixels of images of a `size` that it `was` not; all (H, W)."""
    flow = np.asarray(cv2.resize(flow, grid[::-1], interpolation=cv2.INTER_NEAREST), dtype=np.float32)
    return flow * np.array((size[1] / was[1], size[0] / was[0]), np.float32)


def _not_yet_known(further: Candidates, mask: NDArray[np.bool_]) -> Candidates:
    """Regions that a mask does not hold yet, and those that stand on the road, which may grow."""
    seen = spread(mask, further.region.shape)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(further.region.astype(np.uint8), connectivity=8)
    known = np.bincount(labels[seen], minlength=count) > KNOWN_SHARE * boxes[:, cv2.CC_STAT_AREA]
    keep = ~known | (np.bincount(labels[further.standing], minlength=count) > 0)
    keep[0] = False
    return further.within(keep[labels])


def _cause(evidence: Evidence, candidates: Candidates) -> NDArray[np.uint8]:
    """Index into `CAUSES` of every pixel, or 0 for a stationary camera; (H, W) uint8 at the small size."""
    cause = np.zeros(evidence.sigmas.shape, np.uint8)
    if evidence.moves:
        cause[evidence.beyond] = CAUSES.index("positive_depth")
        cause[evidence.too_low] = CAUSES.index("positive_height")
        cause[candidates.floating] = CAUSES.index("floating")
    return cause


def _parts(evidence: Evidence, shape: tuple[int, int]) -> dict[str, NDArray[np.float32]]:
    """Arrays to look at, at the fine size; flow in its pixels."""
    scale = shape[1] / evidence.sigmas.shape[1]
    parts = {
        "flow_u": evidence.flow[..., 0] * scale,
        "flow_v": evidence.flow[..., 1] * scale,
        "sigmas": evidence.sigmas,
        "misfit": evidence.misfit,
    }
    return {
        name: np.asarray(cv2.resize(part, shape[::-1], interpolation=cv2.INTER_NEAREST), dtype=np.float32)
        for name, part in parts.items()
    }
