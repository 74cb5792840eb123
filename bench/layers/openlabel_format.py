"""ASAM OpenLABEL as other tools write and read it, with coordinate systems, streams and names of every kind.

What travels under the names that `annotations/` uses (`velocity_mps`, `category`, `unclear`, `ground_outline`, ...) is
read from any file; cuboids are read under any name, in any system that a chain of poses leads from.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from bench.layers.classes import left_out, map_classes
from bench.layers.layer import Layer, LayerOptions
from bench.layers.motion import with_motion
from bench.layers.openlabel_document import label_document
from bench.layers.openlabel_file import ELEMENTS, Root, read_label_file
from bench.layers.openlabel_states import StateReader
from bench.layers.openlabel_systems import Systems
from bench.layers.openlabel_times import frame_times
from bench.recordings import Recording, Track, write_text

FILE = "openlabel.json"


class OpenLabelFormat:
    """The standard's files."""

    name = "openlabel"
    description = "ASAM OpenLABEL 1.0 of any tool: cuboids in any coordinate system, times in any unit"

    def read(self, source: Path, recording: Recording, options: LayerOptions) -> Layer:
        """Read a layer; arguments and errors as in `LayerFormat`."""
        file = source / FILE if source.is_dir() else source
        content = read_label_file(file)
        counts = Counter(item.type for item in content.objects.values())
        classes = map_classes(counts, options, source=file)
        times_ns = frame_times(content, recording, options, file)
        systems = Systems(content, recording, file)
        reader = StateReader(content, systems, file)
        ids = _track_ids(content)
        tracks = []
        for uid, item in content.objects.items():
            object_class = classes[item.type]
            if object_class is None:
                continue
            states = reader.states(uid, item, times_ns)
            if not states:
                reader.lost["objects without any cuboid or outline, left out"] += 1
                continue
            track = Track(
                track_id=ids[uid], object_class=object_class, states=states, instance_id=reader.instance_id(uid, item)
            )
            tracks.append(with_motion(track, recording.trajectory))
        lost = [*left_out(classes, counts), *(f"{count} {what}" for what, count in reader.lost.items())]
        lost += [
            f"{len(getattr(content, kind))} {kind}: no place for them" for kind in ELEMENTS if getattr(content, kind)
        ]
        if systems.guessed and tracks:
            lost.append("the file names no coordinate system: read in the frame of the lidar")
        return Layer(tracks=tuple(tracks), timestamps_ns=tuple(sorted(times_ns.values())), lost=tuple(lost))

    def write(self, layer: Layer, recording: Recording, out: Path, options: LayerOptions) -> tuple[str, ...]:
        """Write `openlabel.json`; arguments as in `LayerFormat`."""
        document = label_document(layer, recording, options)
        write_text(out / FILE, json.dumps(document, indent=1, allow_nan=False) + "\n")
        return ()


def _track_ids(content: Root) -> dict[str, str]:
    """The objects' own names where they tell them apart, else the keys."""
    names = [item.name for item in content.objects.values()]
    distinct = all(names) and len(set(names)) == len(names)
    return {uid: item.name if distinct else uid for uid, item in content.objects.items()}
