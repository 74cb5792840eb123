"""What `make perf` times does the work it says; how long it takes is not asserted."""

from bench.evaluation.protocol import load_protocol
from bench.flow.dense import DisFlow
from bench.methods import build_method
from bench.recordings import load_card, open_dataset
from benchmarks.stages import measure, reference_ms


def recordings(card):
    return (handle.open() for handle in open_dataset(load_card(str(card))))


def test_stages_are_timed_beside_any_flow_and_references_by_each_protocol(tiny_card):
    report = measure(
        recordings(tiny_card),
        method=build_method("spherical", {"flow": "dis", "flow_parameters": {"preset": "fast"}}),
        protocol=load_protocol("paper-v1"),
        images=5,
        flow=DisFlow(preset="fast"),
    )
    assert (report.images, set(report.stage_ms)) == (5, {"input", "reference", "method", "counts"})
    assert report.ratio > 1.0
    assert sum(report.stage_ms.values()) <= report.total_ms * 1.01
    spent = reference_ms(recordings(tiny_card), ("paper-v1", "surface-v1"))
    assert all(spent[name] > 0.0 for name in ("paper-v1", "surface-v1"))
