"""The verdict for people and machines."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import pytest
from junitparser import JUnitXml

from bench.gate.tolerances import Tolerance
from bench.gate.verdict import Check, Outcome
from bench.reporting import verdict
from bench.reporting.document import Paragraph
from bench.reporting.verdict import (
    change_lines,
    fallen_line,
    first_blocks,
    folded_lines,
    main_rows,
    other_blocks,
    overall_rows,
    to_annotations,
    to_json,
    to_junit,
    to_markdown,
    worst_line,
)
from tests.gate.factories import ALL_DECIDE, RULES, one, scored, sums, verdict_of
from tests.reporting.printed import printed


@pytest.fixture(scope="module")
def mixed():
    """One row of every outcome."""
    before = {
        "crossing": {"tpr_all": sums([0.9] * 6), "iou": sums([0.2] * 6)},
        "overtaking": {"tpr_all": sums([0.5] * 6), "iou": sums([0.5] * 6)},
        "points=[30, 100)": {"tpr_all": sums([0.5])},
    }
    after = {
        "crossing": {"tpr_all": sums([0.48, 0.5, 0.52] * 2), "iou": sums([0.4] * 6)},
        "overtaking": {"tpr_all": sums([0.5] * 5 + [0.0]), "iou": sums([0.5] * 6)},
        "points=[30, 100)": {"tpr_all": sums([0.5])},
    }
    return verdict_of(scored(before), scored(after, data="x" * 64))


def test_one_kind_of_motion_alone_is_told_once():
    """Where all that moves is of one kind, its rows are those of all moving objects: three metrics fail, not six."""

    def run(*shares):
        metrics = {metric: sums(shares) for metric in ("iou", "tpr_all", "detection_rate_50")}
        return scored({"all_moving": metrics, "static_ego": metrics, "crossing": {}})

    found = verdict_of(run(*[0.9] * 8), run(*[0.5] * 8))
    assert found.headline == "gate FAILED: 3 failed"
    assert main_rows(found) == []
    assert [line.partition("::error title=gate%3A ")[2][:10] for line in to_annotations(found)] == ["all_moving"]
    (suite,) = JUnitXml.fromstring(to_junit(found))
    assert [case.name for case in suite if case.classname == "gate.metrics"] == ["all_moving"]
    assert len(json.loads(to_json(found))["rows"]) == 6, "programs get all"
    lenient = RULES.model_copy(update={"slices": {"all_moving": {"iou": Tolerance(absolute=0.9)}}})
    one_by_its_own = verdict_of(run(*[0.9] * 8), run(*[0.5] * 8), lenient)
    assert [(row.slice_name, row.metric) for row in main_rows(one_by_its_own)] == [("static_ego", "iou")]
    assert one_by_its_own.headline.startswith("gate FAILED: 3 failed")


def test_a_gate_that_passes_says_which_headlines_fell():
    """Breakdowns cut the same object-frames once more, so that the first line counts none of them."""
    before = {
        "all_moving": {"iou": sums([0.9] * 6), "tpr_all": sums([0.9] * 6)},
        "points=[1, 2)": {"iou": sums([0.9] * 6)},
    }
    after = {
        "all_moving": {"iou": sums([0.899] * 6), "tpr_all": sums([0.9] * 5 + [0.6])},
        "points=[1, 2)": {"iou": sums([0.5] * 6)},
    }
    found = verdict_of(scored(before), scored(after))
    assert found.headline == "gate passed: 1 suspect, 1 within tolerance"
    fell = "worse than the baseline: IoU, all 90.0 % -> 89.9 % (within tolerance); TPR, all 90.0 % -> 85.0 % (suspect)"
    assert fallen_line(found) == fell
    assert f"\n{fell}\n" in to_markdown(found).replace("\\", "")
    assert folded_lines(found)[0] == "suspect in breakdowns: 1 (points 1)"
    assert fallen_line(verdict_of(scored(after), scored(before))) == ""


def with_message(verdict, message):
    return replace(verdict, checks=(Check(name="failures", outcome=Outcome.FAILED, message=message),))


def test_junit_has_a_case_for_every_check_and_slice(mixed):
    document = JUnitXml.fromstring(to_junit(mixed))
    cases = {(case.classname, case.name): case for suite in document for case in suite}
    assert len(cases) == len(mixed.checks) + 2 + 1 == 6  # one for all that are not judged
    crossing, overtaking = cases["gate.metrics", "crossing"], cases["gate.metrics", "overtaking"]
    (failure,) = crossing.result
    assert "90.0 % -> 50.0 %, -40.0 pt" in failure.message
    assert failure.text.splitlines()[1:] == change_lines(mixed) != []
    assert [line.split(":")[0] for line in crossing.system_out.splitlines()] == ["improved", "failed"]
    assert cases["gate.data", "data"].is_failure
    assert overtaking.is_passed
    assert "suspect: tpr_all" in overtaking.system_out
    skipped = cases["gate.metrics", "not judged"]
    assert skipped.is_skipped
    assert skipped.result[0].message == folded_lines(mixed)[-1]
    root = ElementTree.fromstring(to_junit(mixed))
    assert [root.attrib[name] for name in ("failures", "skipped", "tests")] == ["2", "1", "6"]
    assert max(map(len, to_junit(mixed).splitlines())) < 400  # a viewer of logs shows it


def test_annotations_are_ten_at_most_the_worst_first():
    before = {f"slice-{k:02d}": {"tpr_all": sums([0.9] * 14)} for k in range(30)}
    after = {f"slice-{k:02d}": {"tpr_all": sums([0.8 - 0.02 * k] * 14)} for k in range(30)}
    lines = to_annotations(verdict_of(scored(before), scored(after)))
    assert len(lines) == 11
    assert all(line.startswith("::error title=gate%3A slice-") for line in lines[:10])
    assert [line.split("slice-")[1][:2] for line in lines[:10]] == [f"{k}" for k in range(29, 19, -1)]
    assert lines[10] == "and 20 more"


def test_checks_come_before_metrics_in_annotations(mixed):
    assert to_annotations(verdict_of(one([0.5] * 6), one([0.5] * 6))) == [], "a pass has none"
    data, crossing = to_annotations(mixed)
    assert data.startswith("::error title=gate%3A data::data changed: ")
    assert crossing.startswith("::error title=gate%3A crossing::tpr_all of crossing: 90.0 %25 -> 50.0 %25")


@pytest.fixture(scope="module")
def one_fault():
    """All that one fault fails: three metrics over everything, one by kind, and breakdowns of the same objects."""
    failing = {"iou": 0.4, "iou_detected": 0.45, "tpr_all": 0.3}
    slices = {
        "all_moving": failing,
        "crossing": {"iou": 0.3},
        "frames": {"false_positive_coverage": 0.2},
        **{f"range_m=[{k}, {k + 2})": failing for k in range(0, 8, 2)},
    }
    before = {name: {metric: sums([0.9] * 5 + [0.8]) for metric in found} for name, found in slices.items()}
    before["frames"]["false_positive_coverage"] = sums([0.2] * 6)
    after = {
        name: {m: sums([v + 0.01 * k for k in range(6)]) for m, v in found.items()} for name, found in slices.items()
    }
    settings = {"weights": {"epipolar": 0.5}, "threshold": 6e-4}
    base = scored(before)
    method = base.manifest.method.model_copy(update={"settings": settings})
    return verdict_of(base, scored(after, method=method, commit="decade"), ALL_DECIDE)


def test_a_fault_that_fails_many_rows_is_one_annotation_a_slice_and_says_what_changed_and_where(one_fault):
    lines = to_annotations(one_fault)
    titles = [line.split("::")[1].removeprefix("error title=gate%3A ") for line in lines]
    assert titles == ["all_moving", "crossing", "frames", "breakdowns"]
    assert "also failed: " in lines[0]
    assert "12 metrics failed in 4 slices, the worst: " in lines[3]
    *changed, noted, same = change_lines(one_fault)
    assert [*changed, same] == [
        "changed: settings: weights.epipolar = 0.5, was 1.0",
        "changed: code: commit decade, was commit c0ffee",
        "as in the baseline: method, protocol, data, reference",
    ]
    assert noted.startswith("note: rules of no row: detection_rate, "), "the rules name all metrics"
    rows = [(row.slice_name, row.metric) for row in overall_rows(one_fault)]
    assert rows == [("all_moving", "iou"), ("all_moving", "tpr_all"), ("frames", "false_positive_coverage")]
    assert [(r.slice_name, r.metric) for r in main_rows(one_fault)] == [
        ("crossing", "iou"),
        ("all_moving", "iou_detected"),
    ]
    assert worst_line(one_fault).startswith(
        "most of tpr_all of all_moving is lost in: drive-0 90.0 % -> 30.0 %; drive-1 "
    )
    assert worst_line(one_fault).count("->") == 3
    (folded,) = folded_lines(one_fault)
    assert folded.startswith("failed in breakdowns: 12 (range_m 12); the worst: ")


def test_the_cause_is_told_first_and_each_fact_once():
    slices = [{"frames": {"false_positive_coverage": sums([0.2] * 6, cases=n)}} for n in (10, 9)]
    fault = {"failures": ("image 3 of 'a': no file",), "reference": "x" * 64, "data": "y" * 64}
    verdict = verdict_of(scored(slices[0]), scored(slices[1], **fault))
    lines = [block.text for block in first_blocks(verdict) if isinstance(block, Paragraph)][1:]
    assert [line.split(": ")[:2] for line in lines[:3]] == [
        ["failed", "the run has 1 failure"],
        ["probably as a consequence", "data changed"],
        ["probably as a consequence", "reference changed"],
    ]
    assert lines[2].endswith("; 6 cases of false_positive_coverage fewer in frames (54, were 60)")
    assert lines[3:] == ["as in the baseline: method, settings, protocol, code"]
    cause, consequences = to_annotations(verdict)
    assert cause == "::error title=gate%3A data::the run has 1 failure: image 3 of 'a': no file"
    assert consequences.count("probably as a consequence: ") == 2


def test_annotations_escape_what_would_start_another_command(mixed):
    (line, *_) = to_annotations(with_message(mixed, "100 %0A\r\n::error::injected"))
    assert line == r"::error title=gate%3A data::100 %250A\r\n::error::injected"
    before, after = (scored({"points=[1, 2)": {"tpr_all": sums([v] * 6)}}) for v in (0.9, 0.1))
    assert (
        "1 metric failed in 1 slice, the worst: tpr_all of points=[1, 2): 90.0 %25"
        in to_annotations(verdict_of(before, after, ALL_DECIDE))[0]
    )
    (named,) = to_annotations(verdict_of(*(scored({"a:b,c": {"tpr_all": sums([v] * 6)}}) for v in (0.9, 0.1))))
    assert named.startswith("::error title=gate%3A a%3Ab%2Cc::")


def test_the_summary_tells_failures_first(mixed):
    text = to_markdown(mixed)
    rows = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| Outcome")]
    assert [row.split("|")[1].split()[-1] for row in rows] == ["failed", "suspect", "improved", "within"]
    assert text.startswith("## gate FAILED: 1 of 3 checks of the data failed, 1 failed, 1 suspect, 1 improved, ")
    assert "\nfailed: data changed" in text
    assert "most in drive-5" in rows[1]
    assert "Suspect: worse than tolerated, but it may be chance" in text, "the word is explained where it is shown"
    folded = text[text.index("<details>") : text.index("</details>")]
    assert folded.startswith("<details><summary>1 other row, ")
    assert f"\n*{folded_lines(mixed)[-1]}*\n" in text
    assert rows[2] not in folded
    assert rows[3] in folded


def test_the_summary_says_how_many_rows_it_leaves_out(one_fault, monkeypatch):
    whole = to_markdown(one_fault)
    assert "make this run the baseline, and commit it:\n\n```\nfisheye-bench gate . --baseline . --update\n```" in whole
    rows = whole.count("\n| ❌")
    shown = len(main_rows(one_fault)) + len(overall_rows(one_fault))
    assert "Left out" not in whole
    monkeypatch.setattr(verdict, "MOST_ROWS", 2)
    cut = to_markdown(one_fault)
    assert cut.count("\n| ❌") == shown + 2 < rows
    assert f"Left out: {rows - shown - 2} more rows, all are in the JSON and JUnit files." in cut


def test_what_a_format_cannot_hold_is_escaped(mixed):
    text = to_markdown(with_message(mixed, "a|b <script> `c`\n# d [e](f) &lt;"))
    assert r"a\|b &lt;script> \`c\`\\n# d [e]\(f) &amp;lt;" in text
    junit = to_junit(with_message(mixed, 'a\x00b\x1bc <&"> \ud800 ü'))
    assert ElementTree.fromstring(junit).find(".//failure").text == 'a\ufffdb\ufffdc <&"> \ufffd ü'


def test_json_holds_everything_and_no_nan(mixed):
    content = json.loads(to_json(mixed), parse_constant=pytest.fail)
    assert content["passed"] is False
    assert len(content["rows"]) == 5
    assert content["worst_recording"] == "drive-0", "as the terminal names it"
    assert len(content["checks"]) == 3
    failed = next(row for row in content["rows"] if row["outcome"] == "failed")
    assert (failed["slice"], failed["metric"], failed["before"], failed["after"]) == ("crossing", "tpr_all", 0.9, 0.5)
    single = next(row for row in content["rows"] if row["outcome"] == "not judged")
    assert (single["difference_ci95"], single["p_value"]) == (None, None)


def test_the_terminal_shows_failures_first_and_how_many_are_not_judged(mixed):
    shown = printed(other_blocks(mixed))
    order = [shown.index(word) for word in ("failed ", "suspect ", "improved ")]
    assert order == sorted(order)
    assert "within" not in shown
    assert folded_lines(mixed)[0] in shown
    assert folded_lines(mixed) == ["not judged: 1 metric, for too few cases or recordings, or by the tolerances"]
