"""The records of a scenario file: sensors, vehicle, street, light, actors, drives and series of drives with draws.

Instead of a value of a series stands a mapping with one of these keys:

    {uniform: [a, b]}        any number from a to b
    {choice: [p, q, ...]}    one of these, which may be whole lists or mappings
    {steps: [a, b]}          from a in the first recording of the series to b in the last, evenly
    {each: [p, q, ...]}      the k-th of these in the k-th repeat of an actor
    {value: name}            what `values` of the series calls so
    {sum: [p, q, ...]}       of numbers, drawn or not
    {product: [p, q, ...]}   likewise

Every draw has random numbers of its own, named by the series, the recording's number in it and the position of the draw
in the file: another series, another field or a longer series change nothing in a recording (a longer series moves its
`steps` alone).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from bench.cameras.stored import camera_from_parameters
from bench.errors import BenchError, UnknownNameError
from bench.recordings.mounting import RollingShutterHead
from bench.recordings.validation import FileModel
from bench.synthesis.bodies import BODIES

DRAWS = ("uniform", "choice", "steps", "each", "value", "sum", "product")
DECIMALS = 4  # of drawn numbers: a tenth of a millimetre


class DrawError(ValueError):
    """A draw that cannot be made.

    Args:
        path: keys on the path to it, from the series on.
        expected: what can stand there.
        got: what does.
    """

    def __init__(self, path: str, expected: str, got: object) -> None:
        self.path, self.expected, self.got = path, expected, repr(got)
        super().__init__(f"{path}: expected {expected}, got {got!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampler:
    """Draws the values of one recording of a series.

    Attributes:
        seed: of the scenario.
        series: name of the series.
        index: of the recording in the series, from 0.
        count: recordings of the series.
        attempt: 0, or how often the recording was drawn before with bodies that overlapped.
        values: the series' named values, drawn where a field asks for them.
    """

    seed: int
    series: str
    index: int
    count: int
    attempt: int = 0
    values: Mapping[str, Any] = field(default_factory=dict)

    def drawn(self, node: Any, path: str, *, repeat: int | None = None) -> Any:
        """A part of the series with every draw replaced by what it gives.

        Args:
            node: the part.
            path: keys on the path to it.
            repeat: number of the repeat that it stands in, from 0.

        Raises:
            DrawError: something that is not a draw.
        """
        if isinstance(node, dict):
            if len(node) == 1 and (kind := next(iter(node))) in DRAWS:
                return self._draw(kind, node[kind], path, repeat)
            return {key: self.drawn(part, f"{path}.{key}", repeat=repeat) for key, part in node.items()}
        if isinstance(node, list):
            return [self.drawn(part, f"{path}.{k}", repeat=repeat) for k, part in enumerate(node)]
        return node

    def _draw(self, kind: str, node: Any, path: str, repeat: int | None) -> Any:
        if kind == "value":
            if not isinstance(node, str) or node not in self.values:
                raise DrawError(path, f"a name under values ({', '.join(self.values) or 'there are none'})", node)
            rest = {name: value for name, value in self.values.items() if name != node}  # so that none can hold itself
            return replace(self, values=rest).drawn(self.values[node], f"values.{node}")
        if kind in {"uniform", "steps"}:
            if not isinstance(node, list) or len(node) != 2:
                raise DrawError(path, "two numbers, [from, to]", node)
            low, high = (self._number(part, f"{path}.{k}", repeat) for k, part in enumerate(node))
            share = self._share(path, repeat) if kind == "uniform" else self.index / max(self.count - 1, 1)
            return round(low + (high - low) * share, DECIMALS)
        if not isinstance(node, list) or not node:
            raise DrawError(path, "a list of at least one", node)
        if kind in {"sum", "product"}:
            numbers = [self._number(part, f"{path}.{kind}.{k}", repeat) for k, part in enumerate(node)]
            return round(math.fsum(numbers) if kind == "sum" else math.prod(numbers), DECIMALS)
        row = int(self._share(path, repeat) * len(node)) if kind == "choice" else repeat
        if row is None or row >= len(node):
            raise DrawError(path, f"at most {len(node)} repeats of the actor", "none" if row is None else row + 1)
        return self.drawn(node[row], f"{path}.{kind}.{row}", repeat=repeat)

    def _number(self, node: Any, path: str, repeat: int | None) -> float:
        """A number, drawn or not."""
        value = self.drawn(node, path, repeat=repeat)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise DrawError(path, "a number", value)
        return value

    def _share(self, path: str, repeat: int | None) -> float:
        """The random number of a position in the file, from 0 to 1."""
        names = (self.series, self.index, self.attempt, path, "" if repeat is None else repeat)
        return float(named_rng(self.seed, "series", *names).random())


def named_rng(seed: int, *names: str | int) -> np.random.Generator:
    """A generator of its own for each purpose, the same on every run and in every process.

    Args:
        seed: of the scenario.
        names: what the numbers are for: recording, sensor, frame.
    """
    text = "/".join([str(seed), *map(str, names)])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "little"))


Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
Number = Annotated[float, Field(ge=-1e4, le=1e4)]  # metres, degrees, seconds: nothing of a scene lies beyond
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Positive = Annotated[float, Field(ge=1e-6, le=1e6)]
Place = tuple[Number, Number, Number]


Named = TypeVar("Named")


def _once(values: tuple[Named, ...]) -> tuple[Named, ...]:
    """Refuse a name, or something of a name, that is there twice."""
    names = [str(getattr(value, "name", value)) for value in values]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"names that occur once; {', '.join(twice)} does not")
    return values


Once = AfterValidator(_once)


def interval_ns(rate_hz: float) -> int:
    """Time between two images or revolutions."""
    return math.floor(1e9 / rate_hz + 0.5)


Share = Annotated[float, Field(gt=0, le=1)]
Quality = Annotated[int, Field(ge=1, le=100)]


class SensorSpec(FileModel):
    """Errors of a camera; the defaults are those of a car's surround-view camera of one megapixel, binned to VGA.

    Attributes:
        edge_light: light at the lens's widest angle against that in the middle; 1 for no vignetting.
        read_noise_grey: standard deviation of the noise in the dark, grey values of 255 at gain 1; 0 for none.
        full_well_electrons: that white stands for at gain 1, which gives the shot noise; null for none.
        jpeg_quality: of OpenCV's encoder, with images in JPEG; null for PNG, without loss.
    """

    edge_light: Share = 0.6
    read_noise_grey: NotNegative = 1.0
    full_well_electrons: Positive | None = 10_000.0
    jpeg_quality: Quality | None = None


class CameraSpec(FileModel):
    """A camera on the ego vehicle.

    Attributes:
        name: as the recording calls it.
        model: a name of `bench.cameras.CAMERA_MODELS`.
        width: image width, px.
        height: image height, px.
        parameters: the model's own.
        position_m: in the vehicle frame.
        yaw_deg: of the optical axis, to the left of forward.
        pitch_down_deg: of the optical axis, below the horizon.
        roll_deg: about the optical axis, clockwise as seen from behind the camera.
        sensor: how it errs.
        rolling_shutter: its readout; null where all rows are exposed at once.
    """

    name: Name
    model: str
    width: int = Field(gt=0, le=8192)
    height: int = Field(gt=0, le=8192)
    parameters: dict[str, Any]
    position_m: Place
    yaw_deg: Number = 0.0
    pitch_down_deg: Number = 0.0
    roll_deg: Number = 0.0
    sensor: SensorSpec = SensorSpec()
    rolling_shutter: RollingShutterHead | None = None

    @model_validator(mode="after")
    def _lens_exists(self) -> CameraSpec:
        try:
            camera_from_parameters(self.model, width=self.width, height=self.height, **self.parameters)
        except (BenchError, TypeError) as error:
            raise ValueError(str(error)) from error
        return self


Speed = Annotated[float, Field(ge=0, le=150)]
OneOrMore = BeforeValidator(lambda values: values if isinstance(values, list | tuple) else (values,))


def _known_body(kind: str) -> str:
    if kind not in BODIES:
        raise ValueError(str(UnknownNameError("kind of actor", kind, BODIES)))
    return kind


class DrivenSpec(FileModel):
    """How something drives: values at `times_s`, linear in between, constant beyond; one value if steady.

    Attributes:
        times_s: after the first image, increasing.
        yaw_rate_degps: positive to the left.
        gear: "reverse" moves against the heading, tail first.
    """

    times_s: tuple[Number, ...] = (0.0,)
    yaw_rate_degps: Annotated[tuple[Number, ...], OneOrMore] = (0.0,)
    gear: Literal["forward", "reverse"] = "forward"

    @model_validator(mode="after")
    def _profile_fits(self) -> DrivenSpec:
        if any(b <= a for a, b in pairwise(self.times_s)):
            raise ValueError("times_s that increase")
        for name in type(self).model_fields:
            if name.startswith(("speed", "yaw_rate")) and len(getattr(self, name)) not in {1, len(self.times_s)}:
                raise ValueError(f"{name}: one value, or one for each of the {len(self.times_s)} of times_s")
        return self


class ActorSpec(DrivenSpec):
    """A body on the scene.

    Attributes:
        name: the track's id.
        kind: a name of `bench.synthesis.bodies.BODIES`.
        at_s: when it is at its position, after the first image.
        position_m: its middle on the ground, x forward and y left of where the ego vehicle's origin is at `at_s`.
        heading_deg: direction of travel at `at_s`, to the left of the ego vehicle's forward direction then.
        speed_mps: along the heading at `times_s`.
        floor_m: height of the ground below it, for someone on the pavement.
    """

    name: Name
    kind: Annotated[str, AfterValidator(_known_body)]
    at_s: NotNegative = 0.0
    position_m: tuple[Number, Number]
    heading_deg: Number = 0.0
    speed_mps: Annotated[tuple[Speed, ...], OneOrMore] = (0.0,)
    floor_m: float = Field(default=0.0, ge=0, le=0.3)


class EgoSpec(DrivenSpec):
    """`host` of a file, how the ego vehicle drives.

    Attributes:
        speed_kmh: over the ground at `times_s`, never negative.
        ramp_s: time over which changes of acceleration and steering are spread, half of it before and half after; a
            driver's foot takes about 0.3 s.
    """

    speed_kmh: Annotated[tuple[Annotated[float, Field(ge=0, le=500)], ...], OneOrMore]
    ramp_s: float = Field(default=0.0, ge=0, le=2)


class LidarSpec(FileModel):
    """A 64-beam lidar that rotates clockwise, as Velodyne's HDL-64E.

    The weakest return by default lets a 10 % target out to about 140 m when it is hit squarely, and asphalt below a
    lidar on the roof out to about 35 m, where it is hit at 3 degrees; beyond, more and more pulses are lost.

    Attributes:
        position_m: in the vehicle frame, axes along the vehicle's.
        beams: "one_origin", all from one point; "two_blocks", each from a place of its own in one of two blocks of 32
            lasers, as in the real sensor.
        rotation_hz: revolutions per second.
        max_range_m: returns from further away are not stored.
        range_noise_m: standard deviation.
        weakest_return_per_m2: reflectance times the cosine of incidence over the square of the range at which half of
            the pulses come back; 0 for all.
        weakest_reflectance: reflectance times the cosine of incidence at which half of the pulses come back from near,
            where the range does not matter; 0 for all. Black gloss paint reflects 0.01 to 0.05 squarely; a mirroring
            coat, be it clear lacquer or water, lets the less through the more it is tilted. Cloth that looks as dark
            reflects more in the near infrared, which this does not know.
        pane_returns: share of pulses on panes of glass that come back, from dust, when they hit squarely; the others
            pass or are mirrored away.
        sector_deg: points are stored in this sector about straight ahead.
    """

    position_m: Place
    beams: Literal["one_origin", "two_blocks"] = "one_origin"
    rotation_hz: float = Field(default=10.0, ge=1, le=100)
    max_range_m: float = Field(default=60.0, ge=1, le=1000)
    range_noise_m: NotNegative = 0.02
    weakest_return_per_m2: NotNegative = 5e-6
    weakest_reflectance: float = Field(default=0.0, ge=0, le=1)
    pane_returns: float = Field(default=0.2, ge=0, le=1)
    sector_deg: float = Field(default=360.0, gt=0, le=360)


class LightSpec(FileModel):
    """Sun and sky, or night; where the sun stands is drawn.

    Attributes:
        kind: "sunny", a bright day; "overcast", no sun, no shadows; "low_sun", morning or evening, long shadows;
            "night", street lamps and the ego vehicle's headlights.
    """

    kind: Literal["sunny", "overcast", "low_sun", "night"] = "sunny"


class SuspensionSpec(FileModel):
    """The body on its springs, those of an everyday family car.

    Attributes:
        road_class: roughness of the road after ISO 8608, of which town streets are A or B; null for a smooth one.
    """

    road_class: Literal["A", "B", "C"] | None = "A"


class BusSpec(FileModel):
    """Wheel ticks and a yaw-rate sensor, as the bus of a series car reports them, 50 times a second.

    The defaults: tyre wear and pressure change a wheel's radius by up to one per cent; an automotive yaw-rate sensor
    has noise of 0.1 deg/s, a rest of bias of 0.1 deg/s after the zero point was taken at standstill, and steps of
    0.02 deg/s.

    Attributes:
        speed_step_kmh: resolution of the reported speed; 0 for none.
        speed_scale_sigma: standard deviation of the factor between reported and true speed, drawn per recording.
        yaw_rate_noise_degps: standard deviation, drawn per message.
        yaw_rate_bias_degps: standard deviation of the bias, drawn per recording.
        yaw_rate_step_degps: resolution of the reported yaw rate; 0 for none.
    """

    speed_step_kmh: NotNegative = 0.01
    speed_scale_sigma: float = Field(default=0.005, ge=0, le=0.2)
    yaw_rate_noise_degps: NotNegative = 0.1
    yaw_rate_bias_degps: NotNegative = 0.1
    yaw_rate_step_degps: NotNegative = 0.02


class CalibrationSpec(FileModel):
    """Errors of the sensors' mountings against their calibration; drawn per recording, for each axis on its own.

    The defaults: a tenth of a degree and half a centimetre, what a calibration at the end of the line leaves; the lidar
    was calibrated on purpose and sits twice as well.

    Attributes:
        camera_angle_deg: standard deviation of a camera's rotation about each of its axes.
        camera_position_m: standard deviation of its position along each axis.
        lidar_angle_deg: as for the cameras.
        lidar_position_m: as for the cameras.
    """

    camera_angle_deg: float = Field(default=0.1, ge=0, le=5)
    camera_position_m: float = Field(default=0.005, ge=0, le=0.2)
    lidar_angle_deg: float = Field(default=0.05, ge=0, le=5)
    lidar_position_m: float = Field(default=0.005, ge=0, le=0.2)


class VehicleSpec(FileModel):
    """Imperfections that make the ego vehicle a real car; what is left out is ideal. `{}` takes the defaults of a part.

    Attributes:
        suspension: null for a rigid car on a smooth road.
        bus: null for exact signals, 100 times a second.
        calibration: null for sensors that sit exactly where the recording says.
    """

    suspension: SuspensionSpec | None = None
    bus: BusSpec | None = None
    calibration: CalibrationSpec | None = None


BEHIND_M, AHEAD_M = -40.0, 100.0  # the street that is built, along the ego vehicle's lane
LARGEST_TURN_RAD = 1.5707963267948966  # a bend ends in the side street, or the street would run into itself
FROM_END_M = 8.0  # crossings and side streets keep away from the ends of what is built
ZEBRA_M = 4.0  # length of a zebra crossing along the street: 3 m at least, 4 m is common
CORNER_M = 4.0  # what the rounded kerb of a corner takes of the street

Density = Annotated[float, Field(ge=0, le=1)]
Along = Annotated[float, Field(ge=BEHIND_M + FROM_END_M, le=AHEAD_M - FROM_END_M)]
Side = Literal["left", "right"]


class SideStreetSpec(FileModel):
    """A street that opens into the ego vehicle's, at a right angle; two at one position make a crossing.

    Attributes:
        at_m: its middle, along the ego vehicle's lane.
        side: of the ego vehicle's street.
        width_m: between its kerbs.
    """

    at_m: Along
    side: Side
    width_m: float = Field(default=5.5, ge=3, le=12)


class StreetSpec(FileModel):
    """The street: straight up to the ego vehicle's first position, a bend of at most 90 degrees, straight again.

    Places are metres along the ego vehicle's lane from its first position. What a field leaves open (which houses,
    where exactly a tree stands, how the asphalt is patched) is drawn anew for each recording.

    Attributes:
        kind: "street", between houses; "car_park", whose lanes are the aisle between two rows of marked bays;
            "avenue", whose lanes are all in the ego vehicle's direction: a median with a guard rail separates them
            from as many opposite ones, and there are few houses.
        lanes_left: lanes to the left of the ego vehicle's own.
        lanes_right: lanes to the right of it.
        lane_width_m: of every lane.
        kerb_m: height of the pavement above the road; 0 for a flush one.
        pavement_m: width of the pavement before the buildings.
        curvature_per_m: 1 / radius of the bend, positive to the left; 0 for a straight street.
        buildings: whether there are any.
        parking: sides with a parking lane of 2.2 m between the outermost lane and the kerb; a car park has bays on
            both sides in any case.
        parked_cars: share of the spaces in the parking lanes or bays that are taken; spaces that actors or the ego
            vehicle come near stay free.
        trees: share of the positions for trees, 9 m apart on each pavement, that have one.
        hedges: share of the fronts that are a garden behind a hedge, fence or wall instead of a house.
        wet: whether rain has darkened road, kerbs and pavement; no water stands on them that would mirror anything.
        marker_posts: whether reflecting posts stand behind the kerbs, every 25 m.
        gantries_at_m: gantries over the whole road, with lit signs.
        zebra_at_m: zebra crossings with lowered kerbs.
        side_streets: with rounded corners and a line to stop or give way at.
    """

    kind: Literal["street", "car_park", "avenue"] = "street"
    lanes_left: int = Field(default=1, ge=0, le=6)
    lanes_right: int = Field(default=0, ge=0, le=6)
    lane_width_m: float = Field(default=3.25, ge=2, le=6)
    kerb_m: float = Field(default=0.12, ge=0, le=0.3)
    pavement_m: float = Field(default=2.5, ge=0.5, le=30)
    curvature_per_m: float = Field(default=0.0, ge=-0.1, le=0.1)
    buildings: bool = True
    parking: Literal["none", "left", "right", "both"] = "none"
    parked_cars: Density = 0.6
    trees: Density = 0.4
    hedges: Density = 0.25
    wet: bool = False
    marker_posts: bool = False
    gantries_at_m: tuple[Along, ...] = ()
    zebra_at_m: tuple[Along, ...] = ()
    side_streets: tuple[SideStreetSpec, ...] = ()

    @property
    def bend_m(self) -> float:
        """Length of the bend; 0 for a straight street."""
        return min(LARGEST_TURN_RAD / abs(self.curvature_per_m), AHEAD_M) if self.curvature_per_m else 0.0

    def has_parking(self, side: Side) -> bool:
        """Return True where cars may stand on a side."""
        return self.kind == "car_park" or self.parking in {side, "both"}

    @model_validator(mode="after")
    def _parked_cars_have_places(self) -> StreetSpec:
        asked = "parked_cars" in self.model_fields_set and self.parked_cars > 0
        if asked and self.kind != "car_park" and self.parking == "none":
            raise ValueError("parked_cars: this street has no place for any; set parking: left, right or both")
        if self.kind == "car_park" and self.parking != "none":
            raise ValueError("parking: a car park has bays on both sides already; leave it out")
        return self

    @model_validator(mode="after")
    def _crossings_fit(self) -> StreetSpec:
        if self.kind != "street" and self.zebra_at_m:
            raise ValueError(f"zebra_at_m: only a street has zebra crossings, not kind: {self.kind}")
        if self.kind == "car_park" and self.side_streets:
            raise ValueError("side_streets: a car park has none")
        if self.kind == "avenue" and any(street.side == "left" for street in self.side_streets):
            raise ValueError("side_streets: only on the right of an avenue, whose median has no opening")
        for street in self.side_streets:
            inwards = self.curvature_per_m * (1 if street.side == "left" else -1) > 0
            if inwards and -street.width_m < street.at_m < self.bend_m + street.width_m:
                raise ValueError(f"side_streets: none inside the bend, which at_m: {street.at_m:g} lies in")
        return self

    @model_validator(mode="after")
    def _crossings_keep_apart(self) -> StreetSpec:
        zebras = [(at_m, ZEBRA_M / 2 + 1.0) for at_m in self.zebra_at_m]
        for side in ("left", "right"):
            mouths = [(s.at_m, s.width_m / 2 + CORNER_M) for s in self.side_streets if s.side == side]
            for (a_m, a_half_m), (b_m, b_half_m) in pairwise(sorted(zebras + mouths)):
                if b_m - a_m < a_half_m + b_half_m:
                    raise ValueError(
                        f"zebra_at_m, side_streets: {a_m:g} and {b_m:g} on the {side} overlap; "
                        f"keep them {a_half_m + b_half_m:g} m apart"
                    )
        return self


LARGEST_REPEAT = 40


class SeriesSpec(FileModel):
    """A series of recordings; any value of its template may be a draw (see `draws`).

    Attributes:
        name: its recordings are called name-01, name-02 ...
        about: one line for the reader of the file.
        count: recordings.
        values: name -> draw, for numbers that several fields share, as a speed and the bend that is driven with it.
        frames: as in a recording, and so are the fields below; each may hold draws.
        cameras: those that record; all of the scenario's where nothing is said.
        host: how the ego vehicle drives.
        street: the static world.
        light: sun, clouds or night.
        actors: everything that is annotated; `repeat` says how often one occurs, as name-1, name-2 ...
    """

    name: Name
    about: str = ""
    count: int = Field(ge=1, le=999)
    values: dict[str, Any] = Field(default_factory=dict)
    frames: Any = 30
    cameras: Any = ()
    host: Any
    street: Any = Field(default_factory=dict)
    light: Any = Field(default_factory=dict)
    actors: Any = ()

    def recording(self, index: int, *, seed: int, attempt: int = 0) -> tuple[dict[str, Any], list[int]]:
        """Draw one recording.

        Args:
            index: of the recording in the series, from 0.
            seed: of the scenario.
            attempt: 0, then 1 and so on to draw it anew.

        Returns:
            values: of a `RecordingSpec`.
            origins: for each of its actors, which of the series' it comes from.

        Raises:
            DrawError: something that is not a draw.
        """
        sampler = Sampler(
            seed=seed, series=self.name, index=index, count=self.count, attempt=attempt, values=self.values
        )
        actors: list[Any] = []
        origins: list[int] = []
        for k, node in enumerate(self.actors if isinstance(self.actors, list | tuple) else []):
            repeats = _actors(node, sampler, f"actors.{k}")
            actors += repeats
            origins += [k] * len(repeats)
        drawn = {
            key: sampler.drawn(getattr(self, key), key) for key in ("frames", "cameras", "host", "street", "light")
        }
        name = f"{self.name}-{index + 1:0{max(2, len(str(self.count)))}d}"
        return {"name": name, "about": self.about, **drawn, "actors": actors}, origins


def _actors(node: Any, sampler: Sampler, path: str) -> list[Any]:
    """An actor, or its repeats."""
    if not isinstance(node, dict) or "repeat" not in node:
        return [sampler.drawn(node, path)]
    repeat = sampler.drawn(node["repeat"], f"{path}.repeat")
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 0 <= repeat <= LARGEST_REPEAT:
        raise DrawError(f"{path}.repeat", f"a whole number from 0 to {LARGEST_REPEAT}", repeat)
    template = {key: part for key, part in node.items() if key != "repeat"}
    repeats = []
    for k in range(repeat):
        actor = sampler.drawn(template, path, repeat=k)
        repeats.append({**actor, "name": f"{actor.get('name')}-{k + 1}"})
    return repeats


class RecordingSpec(FileModel):
    """One recording.

    Attributes:
        name: of its folder.
        about: one line for the reader of the file.
        frames: images of each camera.
        cameras: those of the scenario that record; all where nothing is said.
        host: how the ego vehicle drives.
        street: the static world.
        light: sun, clouds or night.
        actors: everything that is annotated.
    """

    name: Name
    about: str = ""
    frames: int = Field(default=30, ge=1)
    cameras: Annotated[tuple[Name, ...], Once] = ()
    host: EgoSpec
    street: StreetSpec = StreetSpec()
    light: LightSpec = LightSpec()
    actors: Annotated[tuple[ActorSpec, ...], Once] = ()


class ScenarioHead(FileModel):
    """Settings that all recordings of a scenario share.

    Attributes:
        name: of the data set.
        licence: of what is rendered.
        seed: of everything that is random; a recording's random numbers follow from it and its name alone.
        frame_rate_hz: of every camera.
        cameras: on the ego vehicle.
        lidar: on the ego vehicle.
        vehicle: the ego vehicle's suspension, bus and calibration errors; ideal where nothing is said.
    """

    name: Name
    licence: str
    seed: int = Field(ge=0)
    frame_rate_hz: float = Field(default=15.0, ge=0.1, le=1000)
    cameras: Annotated[tuple[CameraSpec, ...], Once] = Field(min_length=1)
    lidar: LidarSpec
    vehicle: VehicleSpec = VehicleSpec()

    def cameras_of(self, spec: RecordingSpec) -> tuple[CameraSpec, ...]:
        """Cameras that record a recording, in the scenario's order."""
        return tuple(camera for camera in self.cameras if not spec.cameras or camera.name in spec.cameras)


class Scenario(ScenarioHead):
    """A scenario whose recordings are all spelled out.

    Attributes:
        recordings: in any order.
    """

    recordings: Annotated[tuple[RecordingSpec, ...], Once] = Field(min_length=1)


class ScenarioFile(ScenarioHead):
    """A scenario as its file has it.

    Attributes:
        recordings: spelled out one by one.
        series: each stands for many recordings.
    """

    recordings: Annotated[tuple[RecordingSpec, ...], Once] = ()
    series: Annotated[tuple[SeriesSpec, ...], Once] = ()

    @model_validator(mode="after")
    def _something(self) -> ScenarioFile:
        if not self.recordings and not self.series:
            raise ValueError("at least one recording, under recordings or series")
        return self
