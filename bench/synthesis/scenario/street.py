"""The static world around the host."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from bench.recordings.validation import FileModel

BEHIND_M, AHEAD_M = -40.0, 100.0  # the street that is built, along the host's lane
LARGEST_TURN_RAD = 1.5707963267948966  # a bend ends in the side street, or the street would run into itself
FROM_END_M = 8.0  # crossings and side streets keep away from the ends of what is built
ZEBRA_M = 4.0  # length of a zebra crossing along the street: 3 m at least, 4 m is common
CORNER_M = 4.0  # what the rounded kerb of a corner takes of the street

Share = Annotated[float, Field(ge=0, le=1)]
Along = Annotated[float, Field(ge=BEHIND_M + FROM_END_M, le=AHEAD_M - FROM_END_M)]
Side = Literal["left", "right"]


class SideStreetSpec(FileModel):
    """A street that opens into the host's, at a right angle; two at one place make a crossing.

    Attributes:
        at_m: its middle, along the host's lane.
        side: of the host's street.
        width_m: between its kerbs.
    """

    at_m: Along
    side: Side
    width_m: float = Field(default=5.5, ge=3, le=12)


class StreetSpec(FileModel):
    """The street: straight up to the host's first place, then a bend of at most 90 degrees, then straight again.

    Places are metres along the host's lane from the host's first place. What a field leaves open (which houses, where
    exactly a tree stands, how the asphalt is patched) is drawn anew for each recording.

    Attributes:
        kind: "street", between houses; "car_park", whose lanes are the aisle between two rows of marked bays;
            "avenue", whose lanes are all in the host's direction: a median with a guard rail parts them from as many
            opposite ones, and there are few houses.
        lanes_left: lanes to the left of the host's own.
        lanes_right: lanes to the right of it.
        lane_width_m: of every lane.
        kerb_m: height of the pavement above the road; 0 for a flush one.
        pavement_m: width of the pavement before the buildings.
        curvature_per_m: 1 / radius of the bend, positive to the left; 0 for a straight street.
        buildings: whether there are any.
        parking: sides with a parking lane of 2.2 m between the outermost lane and the kerb; a car park has bays on
            both sides in any case.
        parked_cars: share of the places in the parking lanes or bays that are taken; places that actors or the host
            come near stay free.
        trees: share of the places for trees, 9 m apart on each pavement, that have one.
        hedges: share of the fronts that are a garden behind a hedge, fence or wall instead of a house.
        wear: of the road, from 0, just laid, to 1, cracked and patched all over; null draws one.
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
    parked_cars: Share = 0.6
    trees: Share = 0.4
    hedges: Share = 0.25
    wear: Share | None = None
    zebra_at_m: tuple[Along, ...] = ()
    side_streets: tuple[SideStreetSpec, ...] = ()

    @property
    def bend_m(self) -> float:
        """Length of the bend; 0 for a straight street."""
        return min(LARGEST_TURN_RAD / abs(self.curvature_per_m), AHEAD_M) if self.curvature_per_m else 0.0

    def has_parking(self, side: Side) -> bool:
        """Whether cars may stand on a side."""
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
