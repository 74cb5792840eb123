"""Digests of what a stored result depends on: contents of files, values, code. Modification times are never trusted."""

from bench.harness.keys.digests import FileDigests, code_digest, digest_of, source_digest
from bench.harness.keys.identity import MethodIdentity
from bench.harness.keys.inputs import RecordingInputs

__all__ = ["FileDigests", "MethodIdentity", "RecordingInputs", "code_digest", "digest_of", "source_digest"]
