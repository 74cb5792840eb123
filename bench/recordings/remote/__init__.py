"""Data on object storage, through fsspec: `root: s3://bucket/prefix` in a card.

Adapters read files, so what a recording needs is fetched into a local folder before it is opened, on the machine that
opens it. A copy is known by what the storage lists (names, sizes, checksums or times): what changed there is fetched
again, what did not is not. Endpoints and credentials are fsspec's own configuration (its files and the environment);
addresses never carry any.
"""

from bench.recordings.remote.datasets import RemoteDataset, remote_recordings
from bench.recordings.remote.fetching import WHOLE, FetchedData, Part
from bench.recordings.remote.names import refuse_unsafe
from bench.recordings.remote.storage import Storage, StoredObject
from bench.recordings.remote.urls import RemoteUrl, parse_place, remote_folder

__all__ = [
    "WHOLE",
    "FetchedData",
    "Part",
    "RemoteDataset",
    "RemoteUrl",
    "Storage",
    "StoredObject",
    "parse_place",
    "refuse_unsafe",
    "remote_folder",
    "remote_recordings",
]
