"""Disturbances that cars' cameras have and the simulator has not: noise, tone, JPEG, dirt, drops, glare, own light.

Everything is drawn once for the images of one frame, as one camera sees them on one drive: dirt, drops, own light and
own shadow keep their place in the image while the world moves by; noise is drawn anew for each image. What moves, and
hence the mask, stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.rigid_scene.scene import pixel_positions, remapped

Bytes = NDArray[np.uint8]
Image = NDArray[np.float32]
Disturbance = Callable[[Sequence[Image], np.random.Generator], list[Image]]


def disturbed(images: Sequence[Bytes], rng: np.random.Generator) -> tuple[Bytes, ...]:
    """Images of one camera as a worse one would have taken them.

    Args:
        images: (H, W) uint8 each, grey, one after the other.
        rng: draws what happens; each of `DISTURBANCES` with its probability.
    """
    disturbed: list[Image] = [image.astype(np.float32) for image in images]
    for disturb, probability in DISTURBANCES:
        if rng.random() < probability:
            disturbed = disturb(disturbed, rng)
    return tuple(np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in disturbed)


def own_light(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Pools of light with soft edges that move along with the vehicle: its headlights and lamps on the ground."""
    height, width = images[0].shape
    light = np.zeros((height, width), np.float32)
    for _ in range(rng.integers(1, 4)):
        _ellipse(light, (rng.uniform(0, width), rng.uniform(0.45, 1.0) * height), rng.uniform(0.05, 0.3) * width, rng)
    light = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.005, 0.04)) * width).astype(np.float32)
    strength, tint = rng.uniform(0.3, 1.8), rng.uniform(0, 25)
    return [image * (1 + strength * light) + tint * light for image in images]


def own_shadow(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """A dark area with straight edges that moves along with the vehicle: its own shadow in low sun."""
    height, width = images[0].shape
    shadow = np.zeros((height, width), np.float32)
    middle = np.array([rng.uniform(0, width), rng.uniform(0.55, 1.0) * height])
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(4, 8)))
    reach = rng.uniform(0.05, 0.35, len(angles)) * width
    corners = middle + reach[:, None] * np.stack([np.cos(angles), 0.6 * np.sin(angles)], axis=1)
    cv2.fillPoly(shadow, [np.rint(corners).astype(np.int32)], 1.0)
    shadow = cv2.GaussianBlur(shadow, (0, 0), float(rng.uniform(0.7, 4))).astype(np.float32)
    depth = rng.uniform(0.3, 0.7)
    return [image * (1 - depth * shadow) for image in images]


def glare(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Light that spreads from what is brightest, in the lens and over the whole image, and moves along with it."""
    height, width = images[0].shape
    small = (max(width // 4, 1), max(height // 4, 1))
    bound, strength, veil = rng.uniform(180, 235), rng.uniform(0.5, 3), rng.uniform(0, 12)
    sigma = float(rng.uniform(0.01, 0.05)) * width / 4
    changed = []
    for image in images:
        bright = cv2.resize(np.maximum(image - bound, 0), small, interpolation=cv2.INTER_AREA)
        spread = cv2.resize(cv2.GaussianBlur(bright, (0, 0), sigma), (width, height), interpolation=cv2.INTER_LINEAR)
        changed.append(image + strength * spread.astype(np.float32) + veil)
    return changed


def drops(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Drops of water on the lens: small lenses that show what is around them upside down and out of focus."""
    height, width = images[0].shape
    at = pixel_positions(width, height).copy()
    share = np.zeros((height, width), np.float32)
    for _ in range(rng.integers(1, 10)):
        middle = np.array([rng.uniform(0, width), rng.uniform(0, height)], np.float32)
        radius = rng.uniform(0.008, 0.05) * width
        left, top = np.maximum(np.floor(middle - radius), 0).astype(int)
        right, bottom = np.ceil(middle + radius).astype(int) + 1
        place = (slice(top, bottom), slice(left, right))
        offset = at[place] - middle
        inside = np.clip(1.5 * (1 - np.hypot(offset[..., 0], offset[..., 1]) / radius), 0, 1)
        at[place] = np.where(inside[..., None] > 0, middle - rng.uniform(1, 4) * offset, at[place])
        share[place] = np.maximum(share[place], inside)
    soft = float(rng.uniform(1, 4))
    changed = []
    for image in images:
        through = remapped(cv2.GaussianBlur(image, (0, 0), soft).astype(np.float32), at, outside=None)
        changed.append(image + share * (through - image))
    return changed


def dirt(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Stains on the lens, out of focus: they darken or veil, and blur what lies behind."""
    height, width = images[0].shape
    stain = np.zeros((height, width), np.float32)
    for _ in range(rng.integers(1, 12)):
        _ellipse(stain, (rng.uniform(0, width), rng.uniform(0, height)), rng.uniform(0.01, 0.08) * width, rng)
    stain = cv2.GaussianBlur(stain, (0, 0), float(rng.uniform(0.004, 0.02)) * width).astype(np.float32)
    stain *= rng.uniform(0.3, 0.95)
    tone, soft = rng.uniform(20, 140), float(rng.uniform(2, 6))
    return [image + stain * (0.5 * cv2.GaussianBlur(image, (0, 0), soft) + 0.5 * tone - image) for image in images]


def tone(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """A camera's tone curve: gamma, contrast, and black that is cut off."""
    gamma, gain, black = rng.uniform(0.5, 1.5), rng.uniform(0.7, 1.3), rng.uniform(0, 12)
    return [255 * np.clip((image - black) / (255 - black), 0, 1).astype(np.float32) ** gamma * gain for image in images]


def exposure_steps(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Exposure that is controlled anew for each image."""
    return [image * float(np.exp(rng.normal(0, 0.08))) for image in images]


def defocus(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """A lens out of focus."""
    sigma = float(rng.uniform(0.4, 1.4))
    return [cv2.GaussianBlur(image, (0, 0), sigma).astype(np.float32) for image in images]


def noise(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Noise of the read-out, of photons and of whole rows."""
    read, photons, rows = rng.uniform(0.5, 5), rng.uniform(0, 0.4), rng.uniform(0, 0.8)
    changed = []
    for image in images:
        sigma = np.sqrt(read**2 + photons**2 * np.maximum(image, 0)).astype(np.float32)
        drawn = rng.standard_normal(image.shape, dtype=np.float32) * sigma
        changed.append(image + drawn + rows * rng.standard_normal((len(image), 1), dtype=np.float32))
    return changed


def denoised(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """A camera's own noise filter: edges stay, weak texture is gone, a dark sky is one grey."""
    spread, size = float(rng.uniform(6, 25)), int(rng.choice([5, 7]))
    return [cv2.bilateralFilter(image, size, spread, 2.0).astype(np.float32) for image in images]


def compressed(images: Sequence[Image], rng: np.random.Generator) -> list[Image]:
    """Blocks of JPEG, or of a video encoder that is short of bits."""
    quality = int(rng.integers(25, 90))
    changed = []
    for image in images:
        whole = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        _, stored = cv2.imencode(".jpg", whole, [cv2.IMWRITE_JPEG_QUALITY, quality])
        changed.append(np.asarray(cv2.imdecode(stored, cv2.IMREAD_GRAYSCALE), dtype=np.float32))
    return changed


def _ellipse(image: Image, middle: tuple[float, float], radius: float, rng: np.random.Generator) -> None:
    axes = int(radius) + 1, int(radius * rng.uniform(0.3, 1.0)) + 1
    cv2.ellipse(image, (int(middle[0]), int(middle[1])), axes, float(rng.uniform(0, 180)), 0, 360, 1.0, -1)


# In the order in which light goes through them, each with its probability: six frames of seven get any.
DISTURBANCES: tuple[tuple[Disturbance, float], ...] = (
    (own_light, 0.12),
    (own_shadow, 0.08),
    (glare, 0.12),
    (drops, 0.06),
    (dirt, 0.08),
    (exposure_steps, 0.15),
    (defocus, 0.15),
    (noise, 0.25),
    (denoised, 0.2),
    (tone, 0.3),
    (compressed, 0.25),
)
