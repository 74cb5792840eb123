"""An S3-compatible server."""

from tests.object_storage import bucket, object_server

__all__ = ["bucket", "object_server"]
