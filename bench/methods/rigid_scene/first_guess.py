"""Dense flow whose first guess is the motion of a rigid scene.

The near road moves by tens of pixels an image, further than a flow finds without help. So the previous image is warped
as if everything below the horizon lay on the road and everything above it infinitely far away; what is left to find is
small wherever the world is static. Where either image shows the ego vehicle's own body, or nothing, both are made
equal: nothing is to be found there, and nothing leaks out of there into the flow around.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.flow import DenseFlow
from bench.methods.rigid_scene.scene import RigidScene, pixel_positions, remapped, sampled


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuidedFlow:
    """Flow from the current to the previous image, and what it started from.

    Attributes:
        flow: (H, W, 2) float32, px; the first guess and what was found beyond it, composed.
        guess: (H, W, 2) float32, px, the first guess; far outside of the image where the lens saw nothing.
        warped: (H, W) uint8, the previous image at the ends of the guess; the current one where `neutral`.
        neutral: (H, W) bool; one of the images shows nothing of the world there.
    """

    flow: NDArray[np.float32]
    guess: NDArray[np.float32]
    warped: NDArray[np.uint8]
    neutral: NDArray[np.bool_]


def guided_flow(
    current: NDArray[np.uint8],
    previous: NDArray[np.uint8],
    *,
    valid: NDArray[np.bool_],
    scene: RigidScene | None,
    flow: DenseFlow,
) -> GuidedFlow:
    """Find dense flow from the motion of a rigid scene on.

    Args:
        current: (H, W) uint8, grey.
        previous: (H, W) uint8, grey.
        valid: (H, W) bool; inside the lens's field and off the ego vehicle's body, in both images alike.
        scene: whose road and horizon the first guess shows, at the images' size; None for no first guess.
        flow: finds the rest.
    """
    guess, warped, neutral = warp(current, previous, valid=valid, scene=scene)
    rest = flow(current, warped)
    # The rest ends at x + rest in the warped image, which shows the previous one at x + rest + guess(x + rest).
    height, width = current.shape
    start = remapped(guess, pixel_positions(width, height) + rest, outside=None)
    return GuidedFlow(flow=rest + start, guess=guess, warped=warped, neutral=neutral)


def warp(
    current: NDArray[np.uint8], previous: NDArray[np.uint8], *, valid: NDArray[np.bool_], scene: RigidScene | None
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.bool_]]:
    """`guess`, `warped` and `neutral` of `GuidedFlow`; arguments as of `guided_flow`."""
    height, width = current.shape
    guess = np.zeros((height, width, 2), np.float32) if scene is None else scene.road_flow()
    neutral = (sampled((~valid).astype(np.float32), guess, outside=1.0) > 0.01) | ~valid
    warped = np.rint(sampled(previous.astype(np.float32), guess)).astype(np.uint8)
    warped[neutral] = current[neutral]
    return guess, warped, neutral
