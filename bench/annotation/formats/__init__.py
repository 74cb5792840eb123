"""Label formats of other tools <-> tracks.

A format reads a tool's files into observations and writes tracks as files. Annotations are in the vehicle frame at each
state's time. What does not fit is never dropped in silence: it stands in `lost`, or it is an error. Nothing is guessed:
frames, units and classes that the files do not say are asked for. A format of another package implements
`bench.annotation.formats.conversion.LabelFormat`.
"""

from bench.annotation.formats.conversion import LabelOptions, LabelSet, import_labels, known_formats, label_format

__all__ = ["LabelOptions", "LabelSet", "import_labels", "known_formats", "label_format"]
