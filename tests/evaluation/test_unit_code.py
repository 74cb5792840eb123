"""A new metric computes no image again: only modules that count decide a stored unit, the others reduce."""

import ast
from pathlib import Path

import pytest

from bench import evaluation
from bench.harness.digests.content import COUNTING, METRIC_CODE, UNIT_CODE

FOLDER = Path(evaluation.__file__).parent
OWN = {file.stem for file in FOLDER.glob("*.py")}


@pytest.mark.parametrize("module", COUNTING)
def test_what_counts_imports_nothing_that_reduces(module):
    imports = [node for node in ast.walk(ast.parse((FOLDER / f"{module}.py").read_text())) if _is_import(node)]
    assert {node.module.removeprefix("bench.evaluation.") for node in imports} & OWN <= {*COUNTING}
    assert not any(node.module == "bench.evaluation" for node in imports), "name the module, so that it is seen here"


def _is_import(node):
    return isinstance(node, ast.ImportFrom) and node.module.startswith("bench.evaluation")


@pytest.mark.parametrize("name", ["SequenceScorer", "ImageMap", "Protocol", "OBJECTS_SCHEMA", "FRAMES_SCHEMA"])
def test_what_a_unit_is_made_with_counts(name):
    imports = [node for node in ast.parse((FOLDER / "__init__.py").read_text()).body if _is_import(node)]
    (module,) = (node.module for node in imports if name in {alias.name for alias in node.names})
    assert module.removeprefix("bench.evaluation.") in COUNTING


def test_a_definition_decides_metrics_and_no_unit():
    assert "evaluation" in METRIC_CODE
    assert not {"evaluation", "evaluation/definitions.py"} & {*UNIT_CODE}
