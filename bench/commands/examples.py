"""Examples of every command, as its help and the page of commands show them."""

from __future__ import annotations

EXAMPLES = {
    "run": ("run demo", "run tiny --method my_method:MyMethod --set threshold=0.5 --protocol surface-v1"),
    "evaluate": ("evaluate demo --predictions my-scores --threshold 0.7 --missing empty --name my-network",),
    "view": (
        "view demo --method spherical --frame 20",
        "view demo --recording crossing-car --frame 10:40 --video crossing.mp4",
    ),
    "validate": ("validate my-data --deep --json findings.json",),
    "synthesize": ("synthesize datasets/tiny.scenario.yaml --out my-drives",),
    "report": ("report reports/runs/demo-spherical",),
    "gate": ("gate reports/runs/demo-spherical --junit gate.xml", "gate reports/runs/demo-spherical --update"),
    "sweep": ("sweep demo --set threshold=3e-4,6e-4,1e-3", "sweep demo --input-error pitch_deg=0,0.5,1"),
    "audit": ("audit demo",),
    "compare": ("compare reports/runs/demo-spherical reports/runs/demo-frame-difference",),
    "leaderboard": ("leaderboard reports/runs --out my-page",),
    "verify": ("verify reports/runs/demo-spherical",),
    "list": ("list methods", "list --schema card"),
    "annotate propose": ("annotate propose my-data",),
    "annotate evaluate": ("annotate evaluate demo --out my-evaluation",),
    "annotate review": ("annotate review my-data --recording drive-1",),
    "annotate export": (
        "annotate export my-data --out annotations/my-data",
        "annotate export my-data --out labels --format boxes --annotated",
    ),
    "annotate import": ("annotate import boxes boxes.csv --dataset my-data --recording drive-1 --class Tram=vehicle",),
    "new method": ("new method my-method",),
    "new dataset": ("new dataset my-data",),
    "new adapter": ("new adapter my-format",),
    "reference export": ("reference export demo --out my-references",),
}


def epilog(command: str) -> str:
    """The examples of a command, below its help."""
    return "\n".join(["Examples:\n\n\b", *(f"fisheye-bench {example}" for example in EXAMPLES[command])])
