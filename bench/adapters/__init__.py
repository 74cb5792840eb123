"""Data sets of others, each read into a `Recording`; `bench.recordings.catalogue` names them and imports one on use."""
