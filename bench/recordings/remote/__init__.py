"""Data on object storage, through fsspec: `root: s3://bucket/prefix` in a card.

Adapters and reports read files, so a remote folder, or the part of it that is needed, is downloaded into a local copy
where it is opened. What the storage lists (sizes, checksums or times) tells which files changed there. Endpoints and
credentials are fsspec's own configuration (its files and the environment); addresses never carry any.
"""

from bench.recordings.remote.datasets import remote_recordings
from bench.recordings.remote.storage import LocalCopy, Storage, StoredObject
from bench.recordings.remote.urls import RemoteUrl, local_folder, parse_location

__all__ = ["LocalCopy", "RemoteUrl", "Storage", "StoredObject", "local_folder", "parse_location", "remote_recordings"]
