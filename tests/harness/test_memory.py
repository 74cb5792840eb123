"""The memory of a process that scores does not grow with what it has scored."""

import json
import subprocess
import sys

import pytest

from tests.support.processes import PATIENCE_S
from tests.support.troubled_runs import environment

pytestmark = pytest.mark.slow

WORKER = """
import json, os, sys
from pathlib import Path

from bench.evaluation.protocol import load_protocol
from bench.harness.manifest import AnswersManifest, CodeOfRun, DatasetOfRun, MethodOfRun
from bench.harness.run import RunRequest, plan_recording, process_task
from bench.methods import build_method
from bench.recordings import load_card, open_dataset

def resident_mb():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

if __name__ == "__main__":
    method = build_method("spherical", {})
    sizes, dataset = [], DatasetOfRun(name="x", card="x", split=None)
    answers = AnswersManifest(dataset=dataset, method=MethodOfRun.of(method), code=CodeOfRun.here())
    for turn in range(int(sys.argv[2])):
        run = Path(f"run-{turn}").absolute()
        card, protocols = load_card(sys.argv[1]), [load_protocol("paper-v1")]
        request = RunRequest(card=card, method=method, folder=run, protocols=protocols)
        for handle in request.recordings():
            for task in plan_recording(method, handle).tasks:
                assert process_task(request, answers, task) == ""
        sizes.append(resident_mb())
    print(json.dumps(sizes))
"""
TURNS, SETTLED, ALLOWED_MB, BOUND_MB = 24, 8, 12.0, 600.0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the present size without a further library")
def test_a_worker_does_not_grow(tiny_card, tmp_path):
    (tmp_path / "worker.py").write_text(WORKER)
    words = [sys.executable, tmp_path / "worker.py", tiny_card, TURNS]
    done = subprocess.run(
        list(map(str, words)),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=environment(),
        check=True,
        cwd=tmp_path,
    )
    sizes = json.loads(done.stdout)
    assert max(sizes) < BOUND_MB
    assert max(sizes[SETTLED:]) - max(sizes[:SETTLED]) < ALLOWED_MB, sizes
