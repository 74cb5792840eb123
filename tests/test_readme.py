"""The example method of docs/your-method.md runs as it is printed."""

import re
import sys
from pathlib import Path

from bench.evaluation import load_protocol
from bench.harness import read_run
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.runs import run_one

PAGE = Path(__file__).parents[1] / "docs/your-method.md"


def test_the_example_method_can_be_pasted(tiny_card, tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    (example,) = [block for block in blocks if block.startswith('"""my_method.py')]
    (tmp_path / "my_method.py").write_text(example, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    method = build_method("my_method:FrameDifference", {"threshold": 20.0})
    summary = run_one(
        card=load_card(str(tiny_card)), method=method, protocol=load_protocol("paper-v1"), out=tmp_path / "run"
    )
    assert read_run(tmp_path / "run").manifest.method.name == "my-frame-difference"
    assert summary.images.evaluated == 12
    assert len(example.splitlines()) <= 32
    sys.modules.pop("my_method")
