"""What of a module is as its source has it, and what was changed after it was loaded."""

import importlib

import pytest

from bench.harness.digests.loaded_code import changed_here, imported_names

SOURCE = """
from ctypes import cdll
from functools import cache

NAMES = {"run", "gate", "view", "sweep", "audit", "compare", "validate", "report", "leaderboard", "evaluate"}
BY_NAME = {"sets": {"a", "b", "c", "d", "e"}, "list": [1, 2.0, (True, None)]}

@cache
def answer():
    return {"of": 41}["of"] + 1

class Held:
    @staticmethod
    def still():
        return answer()

    @classmethod
    def own(cls):
        return cls.still()

    @property
    def value(self):
        return self.own()
"""


@pytest.fixture
def module(tmp_path, monkeypatch, request):
    name = f"constants_{abs(hash(request.node.name))}"
    (tmp_path / f"{name}.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    return importlib.import_module(name), tmp_path / f"{name}.py"


def test_constants_are_as_their_source_has_them_in_whatever_order_a_set_is(module):
    loaded, path = module
    loaded.NAMES = {*sorted(loaded.NAMES, reverse=True)}  # an equal set that was filled in another order
    assert changed_here(loaded, path, "1") is None


@pytest.mark.parametrize("change", [{"NAMES": {"run"}}, {"BY_NAME": {"sets": {"a"}}}, {"NAMES": ["run"]}])
def test_a_constant_that_was_changed_in_the_process_is_named(module, change):
    loaded, path = module
    vars(loaded).update(change)
    (name,) = change
    assert changed_here(loaded, path, "1") == f"{loaded.__name__}.{name}"


def test_code_that_was_executed_is_as_its_source_has_it_wherever_its_lines_stand(module):
    loaded, path = module
    assert {loaded.Held().value for _ in range(100)} == {42}
    path.write_text(f"# a remark\n{SOURCE}")
    assert changed_here(loaded, path, "2") is None


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("answer", "+ 1", "+ 2"),
        ("Held.still", "return answer()", "return 42"),
        ("Held.own", "cls.still()", "42"),
        ("Held.value", "self.own()", "42"),
        ("answer", "}[", "}}["),  # half edited
    ],
)
def test_what_the_source_says_otherwise_since_is_named(module, name, old, new):
    loaded, path = module
    path.write_text(SOURCE.replace(old, new))
    assert changed_here(loaded, path, new) == f"{loaded.__name__}.{name}"


IMPORTS = '''
"""
import mentioned
"""
import one.two as other
from .beside import NAME
from ..above import deep
def late():
    from lazily import factor; import_module("by.name")  # import remarked
'''


def test_imports_are_those_of_statements_and_nothing_that_text_mentions(tmp_path):
    (tmp_path / "module.py").write_text(IMPORTS)
    names = {"one", "one.two", "lazily", "lazily.factor", "by", "by.name"}
    names |= {"pack", "pack.inner", "pack.inner.beside", "pack.inner.beside.NAME", "pack.above", "pack.above.deep"}
    assert imported_names("pack.inner.module", tmp_path / "module.py", "1") == names


@pytest.mark.parametrize("content", [b"def half(:", b"\x7fELF\0"], ids=["half edited", "machine code"])
def test_what_is_no_python_imports_nothing(tmp_path, content):
    (tmp_path / "module.py").write_bytes(content)
    assert imported_names("module", tmp_path / "module.py", "1") == frozenset()
