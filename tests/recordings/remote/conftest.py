"""An S3-compatible server, and what is fetched from it."""

import pytest

from bench.recordings.remote import Storage
from tests.support.object_storage import bucket, object_server

__all__ = ["bucket", "object_server"]


@pytest.fixture
def fetched(monkeypatch) -> list[str]:
    """Names of the objects that were downloaded."""
    names: list[str] = []
    download = Storage.download

    def noted(self, files):
        names.extend(files)
        download(self, files)

    monkeypatch.setattr(Storage, "download", noted)
    return names
