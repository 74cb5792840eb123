"""The commands. Everything heavy is imported when a command runs, so that `--help` is quick."""

from __future__ import annotations

import atexit
import gc
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import typer
from typer.core import TyperGroup

import bench
from bench.cli.start import QUIET, VERBOSE, Verbosity, refuse_unfit, report_lack_of_memory, take_verbosity, verbosity
from bench.errors import DISK_FULL, BenchError, UsageError

DATA_ERROR = 2
OWN_FAULT = 70  # EX_SOFTWARE of sysexits.h; 1, Python's own, would be a verdict of the gate


class Commands(TyperGroup):
    """A group whose help says in whole sentences what each command does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands, each with the first paragraph of its help."""
        named = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        rows = [(name, " ".join((one.help or "").split("\n\n")[0].split())) for name, one in named if one is not None]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


app = typer.Typer(
    name="fisheye-bench",
    cls=Commands,
    help="Score moving-object segmentation in automotive fisheye images against lidar reference polygons.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

annotation_app = typer.Typer(
    cls=Commands,
    help="Bring annotations of other tools into annotations/, and back.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(annotation_app, name="annotations")
new_app = typer.Typer(
    cls=Commands, help="Begin a method, a data set or an adapter.", no_args_is_help=True, rich_markup_mode=None
)
app.add_typer(new_app, name="new")

Dataset = Annotated[str, typer.Argument(help="A data-set card: its path, or a name that `datasets` lists.")]
MethodName = Annotated[str, typer.Option("--method", help="The method; see `methods`.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the method, as YAML; repeatable."),
]
ProtocolName = Annotated[
    str, typer.Option("--protocol", help="paper-v1, surface-v1, extended-v1, masks-v1, or a file.")
]
Protocols = Annotated[
    str,
    typer.Option(
        "--protocol",
        help="paper-v1, extended-v1, surface-v1, masks-v1, or a YAML file; several with commas in between, in one "
        "pass, each with a run of its own.",
    ),
]
Missing = Literal["error", "skip", "empty"]
Names = Literal["auto", "timestamp", "frame", "image"]
Workers = Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")]
Cache = Annotated[
    Path | None,
    typer.Option("--cache", help="Folder where flow, likelihood and reference are cached; default: reports/cache."),
]
NoCache = Annotated[bool, typer.Option("--no-cache", help="Compute everything, cache nothing.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Compute on a Dask cluster: tcp://HOST:PORT, or the file of its scheduler."),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another run in the folder.")]
Split = Annotated[str | None, typer.Option("--split", help="A split of the data set; default: all recordings.")]


def main() -> None:
    """Run the command line and exit."""
    atexit.register(gc.freeze)  # or the end takes half a second of looking through all libraries for garbage
    if not sys.flags.safe_path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # a method or adapter beside the user, named as MODULE:CLASS
    warnings.showwarning = _warn
    try:
        refuse_unfit(sys.argv[1:])
        with report_lack_of_memory():
            app(args=take_verbosity(sys.argv[1:]))
    except Exception as error:  # noqa: BLE001 - the last of all handlers
        told = _told(error)
        if told is None or verbosity() is Verbosity.VERBOSE:
            sys.excepthook(*sys.exc_info())
        if told is None:
            sys.exit(OWN_FAULT)
        _print_error(f"error: {told}")
        sys.exit(DATA_ERROR)


def _told(error: Exception) -> str | None:
    """The line that tells a mistake that the user can mend; None for a fault of ours, which keeps its traceback."""
    if isinstance(error, BenchError):
        return str(error)
    if isinstance(error, OSError) and (
        error.filename is not None or error.errno in DISK_FULL
    ):  # not of our own writers
        do = "; free some disk space, then run the same command again" if error.errno in DISK_FULL else ""
        return f"{error.filename or 'this disk'}: {error.strerror or error}{do}"
    return None


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> None:
    _print_error(f"{filename}:{lineno}: {category.__name__}: {message}")


def _print_error(line: str) -> None:
    from bench.cli.console import say

    say(line, to_errors=True)


def _print_version(asked: bool) -> None:
    if asked:
        from bench.cli.console import say

        say(f"fisheye-bench {bench.__version__}")
        raise typer.Exit


@app.callback()
def everywhere(
    *,
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option(*VERBOSE, help="Say which files are used, and the traceback of errors; of every command.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option(*QUIET, help="Print tables, verdicts and errors alone; of every command.")
    ] = False,
) -> None:
    """Hold the options of the program itself; its help is that of `app`."""


@app.command()
def run(
    dataset: Dataset,
    method: MethodName = "spherical",
    set_: Settings = None,
    protocol: Protocols = "paper-v1",
    split: Split = None,
    out: Annotated[
        str | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the run; default: reports/runs/<data set>-<method>.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    pictures: Annotated[bool, typer.Option(help="Also draw an example frame of every category.")] = True,
    workers: Workers = None,
    cache: Cache = None,
    no_cache: NoCache = False,
    scheduler: Scheduler = None,
    shard: Annotated[
        str | None,
        typer.Option(metavar="I/N", help="Score part I of N only; the command without it ends the run."),
    ] = None,
) -> None:
    """Score a method on a data set: the paper's table, the range maps, pictures.

    A run that was interrupted continues where it stopped, by the same command.
    """
    from bench.cli import running
    from bench.cli.computing import Computing

    asked = running.ScoringOptions(
        dataset=dataset,
        method=method,
        settings=set_ or [],
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
        computing=Computing(workers=workers, cache=cache, no_cache=no_cache, scheduler=scheduler),
    )
    failures = running.run(asked, pictures=pictures) if shard is None else running.run_part(asked, part=shard)
    if failures:
        raise typer.Exit(DATA_ERROR)


@app.command(hidden=True, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def merge() -> None:
    """Say what took the place of `merge`."""
    raise UsageError(
        "merge: a part is an unfinished run; give the command of the parts again without --shard, in a folder whose "
        "units/ holds those of all parts"
    )


@app.command("cluster-example")
def cluster_example(
    name: Annotated[str, typer.Argument(help="slurm-array, slurm-dask or kubernetes.")],
) -> None:
    """Print a file that starts a run on many machines, ready to be filled in."""
    from bench.cli.console import write_out
    from bench.harness.cluster.examples import cluster_example

    write_out(cluster_example(name))


@app.command()
def cache(
    folder: Cache = None,
    limit_gb: Annotated[
        float | None,
        typer.Option(min=0, help="Remove the longest unused entries until the cache holds at most so many GB."),
    ] = None,
    clear: Annotated[bool, typer.Option("--clear", help="Remove everything.")] = False,
) -> None:
    """Say what the cache of flow, likelihood and reference holds, and make it smaller."""
    from bench.cli import listing

    listing.cache(folder, limit_bytes=0 if clear else None if limit_gb is None else int(limit_gb * 1e9))


@app.command()
def evaluate(
    dataset: Dataset,
    predictions: Annotated[Path, typer.Option(help="Folder of masks or scores: [recording/]camera/<name>.png ...")],
    name: Annotated[str | None, typer.Option(help="What results call them; default: predictions-<folder>.")] = None,
    missing: Annotated[
        Missing, typer.Option(help="Images without a prediction: refuse, leave unscored, or count as empty.")
    ] = "error",
    names: Annotated[Names, typer.Option(help="What files are named by; default: found out.")] = "auto",
    threshold: Annotated[float | None, typer.Option(help="Score above which a pixel moves; default: 0.5.")] = None,
    history: Annotated[
        int, typer.Option(help="Score images with this many before them; 1 as methods that compare two.")
    ] = 1,
    protocol: ProtocolName = "paper-v1",
    split: Split = None,
    out: Annotated[
        str | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the run; default: reports/runs/<data set>-NAME.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    pictures: Annotated[bool, typer.Option(help="Also draw an example frame of every category.")] = True,
    workers: Workers = None,
    cache: Cache = None,
    no_cache: NoCache = False,
    scheduler: Scheduler = None,
) -> None:
    """Score masks or scores that any other program wrote, paired with the images by name."""
    from bench.cli import evaluating
    from bench.cli.computing import Computing

    failures = evaluating.evaluate(
        dataset,
        predictions=predictions,
        name=name,
        missing=missing,
        naming=names,
        threshold=threshold,
        history=history,
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
        pictures=pictures,
        computing=Computing(workers=workers, cache=cache, no_cache=no_cache, scheduler=scheduler),
    )
    if failures:
        raise typer.Exit(DATA_ERROR)


@app.command()
def view(
    dataset: Dataset,
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: the first.")] = None,
    camera: Annotated[str | None, typer.Option(help="Name of the camera; default: the first.")] = None,
    frame: Annotated[int | None, typer.Option(help="Index of the image; default: the middle one.")] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST[:STEP]", help="Several images, the last one included.")
    ] = None,
    time_ns: Annotated[int | None, typer.Option(help="The image nearest to this time.")] = None,
    method: MethodName = "spherical",
    set_: Settings = None,
    protocol: ProtocolName = "paper-v1",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of pictures; default: reports/runs/view/<camera>/<image>, none beside a video or log."
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Video (.mp4, .webm, .avi) of true and false areas."),
    ] = None,
    rrd: Annotated[
        Path | None, typer.Option(help="File for the viewer rerun (the optional extra `viewer`), with lidar and boxes.")
    ] = None,
    lidar: Annotated[bool, typer.Option(help="Draw lidar points into the video.")] = True,
) -> None:
    """Draw frames: panels, areas, overlay and lidar clusters of each, a video, or a log for the viewer."""
    from bench.cli import viewing

    request = viewing.ViewRequest(
        recording=recording,
        camera=camera,
        frame=frame,
        frames=frames,
        time_ns=time_ns,
        out=out,
        video=video,
        rrd=rrd,
        lidar=lidar,
    )
    viewing.view(dataset, request, method=method, settings=set_ or [], protocol=protocol)


@app.command()
def validate(
    dataset: Annotated[str, typer.Argument(help="A data-set card; with --adapter a folder of data.")],
    split: Split = None,
    deep: Annotated[bool, typer.Option("--deep", help="Read every image and sweep, not a sample.")] = False,
    errors_only: Annotated[
        bool, typer.Option("--errors-only", help="Exit with 0 where there are warnings alone.")
    ] = False,
    json: Annotated[Path | None, typer.Option(help="Write all findings as JSON to this file.")] = None,
    adapter: Annotated[
        str | None, typer.Option(help="MODULE:FUNCTION; tries whether your adapter keeps the contract.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="With --adapter: an option of it.")
    ] = None,
) -> None:
    """List what looks wrong in a data set: 0 nothing, 1 something, 2 usage or data error."""
    from bench.cli import validating

    if adapter is not None:
        passed = validating.validate_adapter(adapter, Path(dataset), settings=set_ or [])
    else:
        passed = validating.validate(dataset, split=split, deep=deep, errors_only=errors_only, json=json)
    if not passed:
        raise typer.Exit(1)


@app.command()
def synthesize(
    scenario: Annotated[Path, typer.Argument(help="A scenario file.")],
    out: Annotated[Path, typer.Option(help="Folder of the recordings.")],
    workers: Workers = None,
) -> None:
    """Render a scenario into recordings; what is there and up to date stays."""
    from bench.cli.computing import render

    render(scenario, out, workers=workers)


@app.command()
def perf(
    dataset: Annotated[
        str, typer.Argument(help="A data-set card: its path, or a name that `datasets` lists.")
    ] = "demo",
    method: MethodName = "spherical",
    set_: Settings = None,
    protocol: ProtocolName = "paper-v1",
    images: Annotated[int, typer.Option(help="Images to time.")] = 200,
) -> None:
    """Time every stage, and the whole against its Farnebäck call alone in the same run."""
    from bench.cli import timing

    timing.perf(dataset, method=method, settings=set_ or [], protocol=protocol, images=images)


@app.command()
def datasets(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of cards; default: all folders where names are looked up.")
    ] = None,
) -> None:
    """List the data sets that a command finds by name, or the cards of a folder."""
    from bench.cli import listing

    listing.datasets(folder)


@app.command()
def methods() -> None:
    """List the methods that can be scored."""
    from bench.cli import listing

    listing.methods()


@app.command()
def report(
    run: Annotated[str, typer.Argument(help="Folder of a stored run.")],
    category: Annotated[str | None, typer.Option(help="Only this kind of motion, for example preceding.")] = None,
    beside: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Another run of the same data and protocol: both on the same images."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The file; default: index.html or index-CATEGORY.html in the run.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the worst frames, from the data set.")] = True,
) -> None:
    """Write one page to read, from disk and without a network: metrics, charts, the worst cases."""
    from bench.cli import reports

    reports.report(run, category=category, beside=beside, out=out, pictures=pictures)


@app.command()
def cite() -> None:
    """Print BibTeX for the paper and for this software."""
    from bench.cli.console import write_out
    from bench.reporting.citation import bibtex

    write_out(bibtex())


@app.command()
def gate(
    run: Annotated[str, typer.Argument(help="Folder of a stored run.")],
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="The baseline; default: reports/baselines/<data set>.json, with -<protocol> behind the name unless "
            "that is paper-v1, or the one that ships with the package."
        ),
    ] = None,
    tolerances: Annotated[
        str | None, typer.Option(help="default-v1, rendered-v1, or a YAML file; default: default-v1.")
    ] = None,
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the verdict as JSON to this file.")] = None,
    github: Annotated[bool, typer.Option("--github", help="Print GitHub annotations.")] = False,
    whole: Annotated[
        bool, typer.Option("--all", help="List all rows, those of breakdowns too, which cut the same objects again.")
    ] = False,
    update: Annotated[
        bool, typer.Option("--update", help="Judge nothing; store the run as the baseline, and print what changes.")
    ] = False,
    allow_dirty: Annotated[
        bool, typer.Option("--allow-dirty", help="With --update: also from changed, uncommitted code.")
    ] = False,
) -> None:
    """Judge a run by a baseline: 0 no regression, 1 a regression, 2 usage or data error, 3 no verdict."""
    from bench.api.runs import run_folder
    from bench.cli import gating

    folder = run_folder(run)
    if update:
        gating.refuse_with_update(tolerances=tolerances, junit=junit, json=json, github=github)
        gating.update(folder, baseline=baseline, allow_dirty=allow_dirty, whole=whole)
        return
    status = gating.gate(
        folder, baseline=baseline, tolerances=tolerances, junit=junit, json=json, github=github, whole=whole
    )
    raise typer.Exit(status)


@app.command()
def sweep(
    dataset: Dataset,
    what: Annotated[str, typer.Option(help="What to change, for example threshold; `list` lists all.")],
    values: Annotated[str | None, typer.Option(help="Values with commas in between; default: usual ones.")] = None,
    method: MethodName = "spherical",
    set_: Settings = None,
    protocol: ProtocolName = "paper-v1",
    split: Split = None,
    out: Annotated[Path | None, typer.Option(help="Folder of sweeps; default: reports/runs/sweeps-<data set>.")] = None,
    workers: Workers = None,
    cache: Cache = None,
    no_cache: NoCache = False,
) -> None:
    """Score one parameter through many values: a table and a chart.

    Each value is a run in a folder of the sweep. A sweep that was interrupted continues where it stopped, by the same
    command.
    """
    from bench.cli import sweeping
    from bench.cli.computing import Computing

    failures = sweeping.sweep(
        dataset,
        what=what,
        values=values,
        method=method,
        settings=set_ or [],
        protocol=protocol,
        split=split,
        out=out,
        computing=Computing(workers=workers, cache=cache, no_cache=no_cache),
    )
    if failures:
        raise typer.Exit(DATA_ERROR)


@app.command()
def audit(
    dataset: Dataset,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="Rank these methods by lidar references and by exact masks instead; settings behind colons, as in "
            "spherical:flow=dis,truth:grow_px=4; `all` for a list of good and bad ones.",
        ),
    ] = None,
    method: MethodName = "spherical",
    set_: Settings = None,
    protocol: ProtocolName = "paper-v1",
    split: Split = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the audit; default: reports/audit/<data set>.")] = None,
    recordings: Annotated[
        int | None, typer.Option(help="How many recordings, spread over the split; default: all.")
    ] = None,
    workers: Workers = None,
    pictures: Annotated[bool, typer.Option(help="Draw median and worst examples of every class.")] = True,
) -> None:
    """Audit a rendered data set: lidar polygons against exact masks, and why the method misses.

    With --methods: whether the lidar references rank methods as the exact masks do. An audit that was interrupted
    begins again.
    """
    from bench.cli import auditing

    if methods is not None:
        if set_ or method != "spherical" or protocol != "paper-v1":
            raise UsageError(
                "--methods: expected none of --method, --set and --protocol beside it; settings follow a method's name "
                "behind a colon, and the references are always the same"
            )
        failures = auditing.rank(dataset, methods=methods, split=split, out=out, recordings=recordings, workers=workers)
    else:
        failures = auditing.audit(
            dataset,
            method=method,
            settings=set_ or [],
            protocol=protocol,
            split=split,
            out=out,
            recordings=recordings,
            workers=workers,
            pictures=pictures,
        )
    if failures:
        raise typer.Exit(DATA_ERROR)


@app.command()
def compare(
    runs: Annotated[list[str], typer.Argument(help="Folders of stored runs; the first is compared against.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the comparison; default: reports/runs/compare-<run>-<run>.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the frames that changed most, from the data set.")] = True,
) -> None:
    """Compare runs in pairs: differences with intervals, object-frames gained and lost, pictures of the biggest."""
    from bench.api.runs import run_folder
    from bench.cli import reports

    reports.compare([run_folder(run) for run in runs], out=out, pictures=pictures)


@app.command()
def leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder that holds runs at any depth.")] = Path("reports/runs"),
    score: Annotated[
        list[str] | None,
        typer.Option(metavar="DATASET", help="First score all methods on this data set, into FOLDER; repeatable."),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="With --score: these methods; settings behind colons, as in spherical:flow=dis. Default: all that are "
            "registered, and on rendered data the exact masks and exact flow.",
        ),
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="With --score: protocols with commas in between, in one pass.")
    ] = "paper-v1,surface-v1",
    out: Annotated[
        Path | None, typer.Option(help="Also write the page, the chart, leaderboard.md, .csv, .json into this folder.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Show methods on the same images, from rendered data sets.")] = True,
    workers: Workers = None,
    cache: Cache = None,
    no_cache: NoCache = False,
) -> None:
    """List all runs of a folder, those that compare in one table each; with --score, make them first.

    Runs that are there and up to date are not computed again.
    """
    from bench.cli import competing, reports
    from bench.cli.computing import Computing

    if score is None and (methods is not None or workers is not None):
        raise UsageError("leaderboard: expected --score beside --methods and --workers, which say how to score")
    computing = Computing(workers=workers, cache=cache, no_cache=no_cache)
    failures = sum(
        competing.score_all(dataset, methods=methods, protocol=protocol, runs=folder, computing=computing)
        for dataset in score or ()
    )
    if reports.leaderboard(folder, out=out, pictures=pictures) or failures:
        raise typer.Exit(DATA_ERROR)


FormatName = Annotated[str, typer.Argument(metavar="FORMAT", help="A format; see `annotations formats`.")]
Card = Annotated[str, typer.Option("--dataset", help="A data-set card: its path, or a name that `datasets` lists.")]
ClassPairs = Annotated[
    list[str] | None,
    typer.Option(
        "--class", metavar="TOOL=OURS", help="What a class of the tool is for us; none leaves it out; repeatable."
    ),
]
FirstFrame = Annotated[int, typer.Option(help="Number of the first sweep in the tool's frames.")]


@annotation_app.command("formats")
def annotation_formats() -> None:
    """List the formats that can be imported and exported."""
    from bench.cli import annotating

    annotating.formats()


@annotation_app.command("import")
def annotation_import(
    format_: FormatName,
    source: Annotated[Path, typer.Argument(help="The tool's file or folder.")],
    dataset: Card,
    recording: Annotated[str, typer.Option(help="Name of the recording.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of annotation files; default: the card's, or annotations/<data set>.")
    ] = None,
    class_: ClassPairs = None,
    first_frame: FirstFrame = 0,
) -> None:
    """Write a tool's annotations as <recording>.json; say what was read and what was lost."""
    from bench.cli import annotating

    annotating.import_(
        format_,
        source,
        dataset=dataset,
        recording=recording,
        out=out,
        classes=class_ or [],
        first_frame=first_frame,
    )


@annotation_app.command("export")
def annotation_export(
    format_: FormatName,
    dataset: Card,
    out: Annotated[Path, typer.Option(help="Folder; each recording gets one in it.")],
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: all.")] = None,
    class_: ClassPairs = None,
    first_frame: FirstFrame = 0,
) -> None:
    """Write annotations as a tool's files; say what it cannot hold."""
    from bench.cli import annotating

    annotating.export(
        format_,
        dataset=dataset,
        recording=recording,
        out=out,
        classes=class_ or [],
        first_frame=first_frame,
    )


@annotation_app.command("calibration")
def annotation_calibration(
    file: Annotated[Path, typer.Argument(help="An OpenLABEL file with streams.")],
    out: Annotated[Path | None, typer.Option(help="The file; default: printed.")] = None,
) -> None:
    """Give lenses and mountings of an OpenLABEL file as `cameras` and `lidar` of a recording.json."""
    from bench.cli import annotating

    annotating.calibration(file, out)


NewName = Annotated[str, typer.Argument(metavar="NAME", help="Letters, digits, - and _, for example my-method.")]


@new_app.command("method")
def new_method(name: NewName) -> None:
    """Write NAME.py with a method that scores at once, and a test of it."""
    from bench.cli import creating

    creating.new_method(name)


@new_app.command("dataset")
def new_dataset(name: NewName) -> None:
    """Write datasets/NAME.yaml, a program that writes an example recording, and a test of it."""
    from bench.cli import creating

    creating.new_dataset(name)


@new_app.command("adapter")
def new_adapter(name: NewName) -> None:
    """Write NAME/ with an adapter as a package, an example of its layout, a card, and a test of it."""
    from bench.cli import creating

    creating.new_adapter(name)
