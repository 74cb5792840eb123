"""When a recording is looked at, and the ways of everybody in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.driving.path import SECOND_NS, Path, driven_path
from bench.synthesis.scenario import ActorSpec, HostSpec, RecordingSpec, ScenarioHead, interval_ns
from bench.synthesis.seeds import named_rng

FIRST_IMAGE_NS = SECOND_NS  # the recording's clock at the scene's time 0
MARGIN_NS = 200_000_000  # that paths are known before the first and after the last sensor reading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ways:
    """Where the host and the actors are at any time, and when the sensors look.

    Attributes:
        host: the host's way.
        actors: the actors' ways, in the scenario's order.
        image_times_ns: scene clock; 0 is the first image.
        sweep_times_ns: scene clock, reference times.
    """

    host: Path
    actors: tuple[Path, ...]
    image_times_ns: NDArray[np.int64]
    sweep_times_ns: NDArray[np.int64]


def find_ways(head: ScenarioHead, spec: RecordingSpec) -> Ways:
    """The ways of a recording."""
    turn_ns = interval_ns(head.lidar.rotation_hz)
    image_times_ns = np.arange(spec.frames, dtype=np.int64) * interval_ns(head.frame_rate_hz)
    # One revolution before the first image and one after the last, so that every image lies between two sweeps.
    # Camera and lidar keep their own time: where in its revolution the lidar is at the first image is up to chance.
    phase_ns = int(named_rng(head.seed, spec.name, "lidar phase").integers(turn_ns))
    sweep_times_ns = np.arange(-1, int(image_times_ns[-1]) // turn_ns + 2, dtype=np.int64) * turn_ns + phase_ns
    staged_ns = [_milliseconds(actor.at_s) for actor in spec.actors]
    first_ns = int(sweep_times_ns[0]) - turn_ns - MARGIN_NS
    last_ns = max([int(sweep_times_ns[-1]) + turn_ns + MARGIN_NS, *staged_ns])
    host = _host_path(spec.host, first_ns, last_ns)
    return Ways(
        host=host,
        actors=tuple(_actor_path(actor, host, first_ns, last_ns) for actor in spec.actors),
        image_times_ns=image_times_ns,
        sweep_times_ns=sweep_times_ns,
    )


def _host_path(spec: HostSpec, first_ns: int, last_ns: int) -> Path:
    return driven_path(
        times_s=spec.times_s,
        speeds_mps=_sign(spec.gear) * np.array(spec.speed_kmh) / 3.6,
        yaw_rates_radps=np.radians(spec.yaw_rate_degps),
        first_ns=first_ns,
        last_ns=last_ns,
        ramp_s=spec.ramp_s,
    )


def _actor_path(spec: ActorSpec, host: Path, first_ns: int, last_ns: int) -> Path:
    at_ns = _milliseconds(spec.at_s)
    world_from_vehicle = host.at([at_ns]).transform()
    place = world_from_vehicle.apply(np.array([*spec.position_m, 0.0]))
    forward = world_from_vehicle.rotation[:, 0]
    heading_rad = float(np.arctan2(forward[1], forward[0]) + np.radians(spec.heading_deg))
    return driven_path(
        times_s=spec.times_s,
        speeds_mps=_sign(spec.gear) * np.array(spec.speed_mps),
        yaw_rates_radps=np.radians(spec.yaw_rate_degps),
        first_ns=first_ns,
        last_ns=last_ns,
        through=(float(place[0]), float(place[1]), heading_rad),
        through_ns=at_ns,
        floor_m=spec.floor_m,
    )


def _sign(gear: str) -> float:
    return -1.0 if gear == "reverse" else 1.0


def _milliseconds(seconds: float) -> int:
    """Time in ns, to the millisecond, as paths have their nodes."""
    return round(seconds * 1000) * 1_000_000
