"""People who go side by side are one cluster; seen along their way, their heads or bodies are apart."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from bench.annotation.boxes import Box, fit_box
from bench.annotation.settings import ProposalSettings
from bench.annotation.tracking import Fragment, Observation

Floats = NDArray[np.float64]
LARGEST_M = (2.6, 2.6, 2.2)  # length, width and height of people beside each other; what is larger is a vehicle
FROM = (0.8, 0.2)  # of the height: heads, which are apart where arms touch; bodies, of which a child's is lower
CELL_M, SMOOTH_CELLS = 0.05, 1.5  # of the profile of the points seen from above
TOP = 0.99  # quantile of the heights
APART_M = 0.45  # two people are at least this far apart
VALLEY = 0.5  # of the lower peak, that the profile falls to between two people


def split_people(box: Box, settings: ProposalSettings) -> list[Box]:
    """Cut a track between people beside each other.

    Args:
        box: a believed track.
        settings: of the proposals.

    Returns:
        A box for each of the people, in the order across the heading, if each is believed to move; else `box`.
    """
    if (box.size_m > LARGEST_M).any():
        return [box]
    seen = [_in_box(box, number) for number in range(len(box.yaw_rad))]
    across_m, up_m = np.concatenate(seen).T
    top_m = np.quantile(up_m, TOP)
    cuts_m = max((_valleys(across_m[up_m > share * top_m]) for share in FROM), key=len)
    if not len(cuts_m):
        return [box]
    parts = [
        fit_box(_part(box.fragment, [np.searchsorted(cuts_m, one[:, 0]) == part for one in seen], part), settings)
        for part in range(len(cuts_m) + 1)
    ]
    believed = [part for part in parts if part is not None]
    return believed if len(believed) == len(parts) else [box]


def _in_box(box: Box, number: int) -> Floats:
    """(N, 2) float64, m, the points of a sweep across the heading from the track's place, and above the road."""
    points, yaw = box.motion.points[number], box.yaw_rad[number]
    across = (points[:, :2] - box.motion.positions_m[number]) @ np.array([-np.sin(yaw), np.cos(yaw)])
    return np.column_stack([across, points[:, 2] - box.bottom_m[number]])


def _valleys(places_m: Floats) -> Floats:
    """(K,) float64, m, where a profile of points is lowest between two peaks that stand apart."""
    if len(places_m) < 2:
        return np.empty(0)
    low = places_m.min() - APART_M
    counts = np.bincount(((places_m - low) / CELL_M).astype(np.intp), minlength=2)
    profile = gaussian_filter1d(np.pad(counts, (0, int(APART_M / CELL_M))).astype(np.float64), SMOOTH_CELLS)
    peaks, _ = find_peaks(profile, distance=APART_M / CELL_M, height=VALLEY * profile.max() / 2)
    cuts = []
    for left, right in pairwise(peaks):
        lowest = left + int(np.argmin(profile[left : right + 1]))
        if profile[lowest] < VALLEY * min(profile[left], profile[right]):
            cuts.append(low + (lowest + 0.5) * CELL_M)
    return np.array(cuts)


def _part(fragment: Fragment, chosen: list[NDArray[np.bool_]], number: int) -> Fragment:
    observations = [
        Observation(cloud=one.cloud, rows=one.rows[rows])
        for one, rows in zip(fragment.observations, chosen, strict=True)
        if rows.any()
    ]
    return replace(fragment, observations=tuple(observations), part=number)
