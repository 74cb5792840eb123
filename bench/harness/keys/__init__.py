"""What a stored result depends on, as digests: contents of files, values, code. Times of change are never trusted."""

from bench.harness.keys.code import code_digest, source_digest
from bench.harness.keys.files import FileDigests
from bench.harness.keys.identity import MethodIdentity
from bench.harness.keys.inputs import RecordingInputs
from bench.harness.keys.values import digest_of

__all__ = ["FileDigests", "MethodIdentity", "RecordingInputs", "code_digest", "digest_of", "source_digest"]
