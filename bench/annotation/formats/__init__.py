"""Label formats of other tools <-> tracks.

A format reads a tool's files into observations and writes tracks as files. Annotations are in the vehicle frame at each
state's time. What does not fit is never dropped in silence: it stands in `lost`, or it is an error. Nothing is guessed:
frames, units and classes that the files do not say are asked for. The labels of any other tool
become a table of boxes.
"""
