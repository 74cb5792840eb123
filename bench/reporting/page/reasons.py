"""Why an object was missed or an image is full of false positives, as far as the numbers say so.

Every sentence states the figure that it rests on. Where no rule applies, that is what is said.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

MOST = 0.5  # of the missed or false pixels, to be called the reason
WELL_FOUND = 0.8
FEW_POINTS = 20
SMALL_PX = 400
SAME_SPEED_MPS = 0.5
BLIND_BAND_DEG = 10.0
BELOW_HORIZON = {"preceding": "positive height", "approaching": "anti-parallel"}  # they need the road behind the object
SHOWN = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectEvidence:
    """What the image shows of an object beyond the stored counts; shares are of its missed pixels, NaN without any.

    Attributes:
        undefined: share in cells where the method could not say.
        blind_band: share within `BLIND_BAND_DEG` of the direction of travel, forward or backward.
        above_horizon: share that looks upwards.
        likelihood: median motion likelihood; NaN for a method without.
    """

    undefined: float
    blind_band: float
    above_horizon: float
    likelihood: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEvidence:
    """What the image shows of its false positives beyond the stored counts; shares are of them, NaN without any.

    Attributes:
        below_horizon: share that looks downwards.
        static_objects: share on annotated objects that stand still.
    """

    below_horizon: float
    static_objects: float


def object_reason(row: Mapping[str, object], evidence: ObjectEvidence | None, *, threshold: float | None) -> str:
    """Say why an object-frame was covered so little.

    Args:
        row: of `OBJECTS_SCHEMA`, evaluated, with `coverage`.
        evidence: from the image; None without the data.
        threshold: of the method's likelihood; None where it has none.
    """
    if _number(row, "coverage") >= WELL_FOUND:
        return f"Nothing to explain: {_percent(_number(row, 'coverage'))} of it is found."
    found = [*(_seen_reasons(row, evidence) if evidence else []), *_stored_reasons(row)]
    told = " Also: ".join(found[:SHOWN]) or "No single reason found in the numbers."
    if evidence is None or math.isnan(evidence.likelihood) or threshold is None or evidence.undefined >= MOST:
        return told
    side = "below" if evidence.likelihood <= threshold else "above"
    told += f" On its missed pixels the median motion likelihood is {evidence.likelihood:.1e}, {side} the threshold of "
    return told + f"{threshold:.1e}."


def frame_reason(row: Mapping[str, object], evidence: FrameEvidence | None) -> str:
    """Say where the false positives of an image come from.

    Args:
        row: of `FRAMES_SCHEMA`, scored, with `coverage`.
        evidence: from the image; None without the data.
    """
    false_px = max(int(_number(row, "fp_px")), 1)
    causes = row["fp_by_cause"]
    found = []
    if isinstance(causes, Mapping) and causes:
        name, pixels = max(causes.items(), key=lambda item: item[1])
        words, share = str(name).replace("_", " "), pixels / false_px
        lead = "Mostly" if share >= MOST else "No single cause; the largest is"
        found.append(f"{lead} {words}, with {_percent(share)} of the false pixels.")
    largest = _number(row, "fp_largest_px") / false_px
    if largest >= MOST:
        found.append(f"One connected patch makes {_percent(largest)} of them.")
    attached = 1 - _number(row, "fp_unattached_px") / false_px
    if attached >= MOST:
        found.append(f"{_percent(attached)} are in patches that touch a moving object.")
    if evidence is not None and evidence.below_horizon >= MOST:
        found.append(f"{_percent(evidence.below_horizon)} lie below the horizon, on the ground and what stands on it.")
    if evidence is not None and evidence.static_objects >= MOST / 5:
        found.append(f"{_percent(evidence.static_objects)} lie on annotated objects that stand still.")
    return " ".join(found) or "No single reason found in the numbers."


def _seen_reasons(row: Mapping[str, object], evidence: ObjectEvidence) -> list[str]:
    found = []
    if evidence.undefined >= MOST:
        found.append(f"The method could not say: {_percent(evidence.undefined)} of the missed pixels are undefined.")
    constraint = BELOW_HORIZON.get(str(row["category"]))
    if constraint is not None and evidence.above_horizon >= MOST:
        found.append(
            f"{_percent(evidence.above_horizon)} of the missed pixels lie above the horizon, where {constraint}, the "
            f"constraint for {row['category']} objects, cannot work."
        )
    if evidence.blind_band >= MOST:
        found.append(
            f"Blind band: {_percent(evidence.blind_band)} of the missed pixels lie within {BLIND_BAND_DEG:.0f}° of the "
            "direction of travel, where the image hardly moves."
        )
    return found


def _stored_reasons(row: Mapping[str, object]) -> list[str]:
    found = []
    region, polygon, points = (_number(row, name) for name in ("region_px", "polygon_px", "points"))
    if region < MOST * polygon:
        found.append(f"Occluded: {_percent(1 - region / polygon)} of its outline lies behind nearer objects.")
    speed, ego = _number(row, "speed_mps"), _number(row, "ego_speed_mps")
    if row["category"] == "preceding" and abs(speed - ego) < SAME_SPEED_MPS:
        found.append(f"It drives almost as fast as the host ({speed:.1f} and {ego:.1f} m/s), so little changes to see.")
    if points < FEW_POINTS:
        found.append(f"Only {points:.0f} lidar points: the reference itself is uncertain.")
    if region < SMALL_PX:
        found.append(f"Small: {region:.0f} pixels.")
    return found


def _number(row: Mapping[str, object], name: str) -> float:
    return float(str(row[name]))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
