"""Digests of what a stored result depends on: contents of files, values, code. Modification times are never trusted."""

from bench.harness.digests.content import FileDigests, code_digest, digest_of, short_digest
from bench.harness.digests.inputs import RecordingInputs
from bench.harness.digests.method_code import MethodCode

__all__ = ["FileDigests", "MethodCode", "RecordingInputs", "code_digest", "digest_of", "short_digest"]
