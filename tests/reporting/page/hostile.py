"""Names that a data set may hold and a page must survive."""

import shutil

import pyarrow as pa

from bench.evaluation import load_protocol, sum_run, summary_of, write_sums
from bench.harness import read_run, read_tables
from bench.harness.stored import SUMMARY, SUMS
from tests.support.counts import write_counts

TRACK = "</script><script>window.broken = true</script><!--<img src=x onerror='window.broken = true'> it's & \u2028"
PLAIN = "walker"


def hostile_run(run, folder):
    """A copy of the run in which one object has a name that would end the script and start another."""
    copy = shutil.copytree(run, folder / "hostile")
    objects, frames = read_tables(copy / "paper-v1")
    names = [TRACK if name == PLAIN else name for name in objects["track_id"].to_pylist()]
    place = objects.schema.get_field_index("track_id")
    objects = objects.set_column(place, objects.schema.field(place), pa.array(names))
    summary = read_run(copy).summary
    results = copy / "paper-v1"
    shutil.rmtree(results / "counts")
    write_counts(results, objects, frames)
    sums = sum_run(objects, frames, protocol=load_protocol("paper-v1"))
    write_sums(sums, results / SUMS)
    figures = summary_of(sums, protocol=load_protocol("paper-v1"))
    changed = {name: getattr(figures, name) for name in type(figures).model_fields}
    changed["failures"] = ("<b>one & all</b>",)
    (results / SUMMARY).write_text(summary.model_copy(update=changed).model_dump_json())
    return copy
