"""Manifests and provenance of runs that tests write by hand."""

from bench.evaluation import Protocol, load_protocol
from bench.evaluation.summary import ProtocolStamp
from bench.harness import Provenance
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest
from bench.harness.method_stamp import MethodStamp


def provenance(*, images: int = 9) -> Provenance:
    return Provenance(started_utc="2026-01-02T03:04", seconds=2.0, stage_seconds={}, images=images, peak_memory_mb=1.0)


def manifest(
    *,
    dataset: str = "demo",
    card: str = "datasets/demo.yaml",
    split: str | None = None,
    method: str = "nothing",
    settings: dict[str, object] | None = None,
    protocol: Protocol | None = None,
    commit: str | None = None,
    reference: str = "",
) -> Manifest:
    rules = protocol or load_protocol("paper-v1")
    return Manifest(
        dataset=DatasetOfRun(name=dataset, card=card, split=split, data=""),
        method=MethodStamp(name=method, settings=settings or {}),
        protocol=ProtocolStamp(name=rules.name, version=rules.version, digest=rules.digest),
        code=CodeOfRun(version="0", commit=commit, python="3", libraries={}),
        reference=reference,
    )
