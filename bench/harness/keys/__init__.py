"""What a stored result depends on, as digests: contents of files, values, code. Times of change are never trusted."""

from bench.harness.keys.digests import FileDigests, code_digest, digest_of, source_digest
from bench.harness.keys.identity import MethodIdentity
from bench.harness.keys.inputs import RecordingInputs

__all__ = ["FileDigests", "MethodIdentity", "RecordingInputs", "code_digest", "digest_of", "source_digest"]
