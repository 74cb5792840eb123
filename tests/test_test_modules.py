"""Test modules share helpers through `tests/support/`, and through the plain modules and `conftest.py` beside them."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.startswith(("tests.", "benchmarks."))}


def test_no_module_imports_a_test_module():
    modules = [path for folder in ("tests", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    assert len(modules) > 100
    wrong = [f"{path.relative_to(ROOT)}: {name}" for path in modules for name in imported(path) if ".test_" in name]
    assert wrong == []
