import sys
from importlib import import_module, invalidate_caches

import numpy as np

FUNCTION = """
from bench.machine_code import compiled
from loops.numbers import STEP

@compiled
def add(values):
    for k in range(len(values)):
        values[k] += STEP
"""


def test_machine_code_is_cached_until_a_file_beside_it_changes(tmp_path, monkeypatch):
    """By itself numba would take it again when a file changes that the function's own file imports."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    package = tmp_path / "loops"
    package.mkdir()
    (package / "function.py").write_text(FUNCTION)
    steps, cached = [], []
    for step in (1.0, 2.0, 2.0):
        (package / "numbers.py").write_text(f"STEP = {step}")
        for name in [name for name in sys.modules if name.partition(".")[0] == "loops"]:
            monkeypatch.delitem(sys.modules, name)
        invalidate_caches()
        add, values = import_module("loops.function").add, np.zeros(1)
        add(values)
        steps.append(values[0])
        cached.append(sum(add.stats.cache_hits.values()))
    assert (steps, cached) == ([1.0, 2.0, 2.0], [0, 0, 1])
