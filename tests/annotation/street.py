"""The synthetic street, and what is proposed there."""

from dataclasses import replace
from math import radians

import numpy as np

from bench.annotation.decisions import to_tracks
from bench.annotation.settings import ProposalSettings
from bench.annotation.store import Review
from bench.recordings import open_native
from tests.support import drive

# The street's beams lie 1 and 1.5 degrees apart, and a cell of a range image holds one.
COARSE = ProposalSettings(azimuth_rad=radians(1.0), elevation_rad=radians(1.5))


def street(root):
    """The drive, its annotated boxes a little larger than the objects, as people draw them."""
    recording = open_native(drive.write_drive(root))
    return replace(recording, tracks=tuple(enlarged(track) for track in recording.tracks))


def enlarged(track, by_m=0.2):
    def larger(state):
        return replace(state, shape=replace(state.shape, size_m=state.shape.size_m + np.array([by_m, by_m, 0.0])))

    return replace(track, states=tuple(larger(state) for state in track.states))


def annotated(proposals, recording):
    """Proposals as annotations of the recording."""
    return to_tracks(Review(dataset="street", recording="street", tracks=proposals), recording, unreviewed=True)
