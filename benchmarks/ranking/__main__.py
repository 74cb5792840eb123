"""`python -m benchmarks.ranking CARD`: rank methods by lidar references and by exact masks; with fewer beams, too.

python -m benchmarks.ranking datasets/paper.yaml --recordings 42 --out reports/audit/paper
python -m benchmarks.ranking datasets/demo.yaml --beams 64,32,16
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.commands.audit import audit_folder
from bench.commands.console import print_blocks, print_failures, progress_bar, say, take_verbosity
from bench.commands.options import rendered_card
from bench.execution import local_executor, usable_cores
from benchmarks.ranking.agreement import run_ranking
from benchmarks.ranking.beams import run_beams
from benchmarks.ranking.beams_report import beams_table, write_beams_files
from benchmarks.ranking.predictions import parse_predictions
from benchmarks.ranking.ranking_report import ranking_tables, write_ranking_files


def whole_numbers(text: str) -> tuple[int, ...]:
    """Numbers with commas, each once."""
    return tuple(dict.fromkeys(int(word) for word in text.split(",")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("card", help="a rendered data set")
    parser.add_argument("--methods", help="names with commas, settings behind colons, as in truth:grow_px=4; or all")
    parser.add_argument("--beams", type=whole_numbers, help="so many rings of the lidar, as in 64,32,16")
    parser.add_argument("--split")
    parser.add_argument("--recordings", type=int, help="how many, spread over the split")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--workers", type=int, default=usable_cores())
    asked = parser.parse_args()
    methods = asked.methods or ("all" if asked.beams is None else None)
    predictions = () if methods is None else parse_predictions(methods)
    executor = local_executor(asked.workers)
    card, out = rendered_card(asked.card, asked.split, executor=executor), audit_folder(asked.card, asked.out)
    take_verbosity([])
    with progress_bar(f"ranking on {card.name}", "recordings") as progress:
        named = {"split": asked.split, "recordings": asked.recordings, "executor": executor, "progress": progress}
        if asked.beams is None:
            found = run_ranking(card, predictions=predictions, **named)
            tables, files = ranking_tables(found), write_ranking_files(out, found)
        else:
            found = run_beams(card, beams=asked.beams, predictions=predictions, **named)
            tables, files = [beams_table(found)], write_beams_files(out, found)
    print_blocks(tables)
    print_failures(found.stored.failures, all_in=str(out))
    for file in files:
        say(str(file))


if __name__ == "__main__":
    main()
