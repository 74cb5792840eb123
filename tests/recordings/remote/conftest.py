"""An S3-compatible server, and what is fetched from it."""

import pytest

from bench.recordings import object_storage
from tests.support.object_storage import bucket, object_server

__all__ = ["bucket", "object_server"]


@pytest.fixture
def fetched(monkeypatch) -> list[str]:
    """Names of the objects that were downloaded."""
    names: list[str] = []
    download = object_storage.download

    def noted(url, files):
        names.extend(files)
        download(url, files)

    monkeypatch.setattr(object_storage, "download", noted)
    return names
