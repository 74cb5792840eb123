"""Manifests and provenance of runs that tests write by hand."""

from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.summary import ProtocolOfRun
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest, MethodOfRun
from bench.harness.stored import Provenance
from bench.methods import known_methods


def provenance(*, images: int = 9) -> Provenance:
    made = {"started_utc": "2026-01-02T03:04", "seconds": 2.0, "workers": 1, "peak_memory_mb": 1.0}
    return Provenance(**made, images=images, images_asked=images)


def method_of_run(
    name: str,
    *,
    settings: dict[str, object] | None = None,
    place: str = "",
    code_digest: str = "0" * 64,
) -> MethodOfRun:
    place = place or known_methods().get(name, "own:Own")
    return MethodOfRun(name=name, settings=settings or {}, place=place, history=1, code_digest=code_digest)


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
    recordings: dict[str, str] | None = None,
) -> Manifest:
    rules = protocol or load_protocol("paper-v1")
    return Manifest(
        dataset=DatasetOfRun(name=dataset, card=card, split=split, recordings=recordings or {}),
        method=method_of_run(method, settings=settings or {}),
        protocol=ProtocolOfRun(name=rules.name, version=rules.version, digest=rules.digest),
        code=CodeOfRun(version="0", commit=commit, libraries={"Python": "3"}, answers="a" * 64, counts="c" * 64),
        reference=reference,
    )
