"""Local copies that runs at an address are stored from and read into; data are read through `object_storage`."""

from bench.recordings.remote.storage import LocalCopy, Storage, StoredObject, local_folder

__all__ = ["LocalCopy", "Storage", "StoredObject", "local_folder"]
