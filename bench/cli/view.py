"""`view`: pictures, videos and viewer logs of frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from bench.cli import options
from bench.cli.console import note_files, say
from bench.cli.progress import progress_bar
from bench.errors import UsageError


def view(
    dataset: options.Dataset,
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: the first.")] = None,
    camera: Annotated[str | None, typer.Option(help="Name of the camera; default: the first.")] = None,
    frame: Annotated[int | None, typer.Option(help="Index of the image; default: the middle one.")] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST[:STEP]", help="Several images, the last one included.")
    ] = None,
    time_ns: Annotated[int | None, typer.Option(help="The image nearest to this time.")] = None,
    method: Annotated[
        str | None, typer.Option(help="Draw what this method finds, too: a name, or module:Class; default: none.")
    ] = None,
    set_: options.Settings = None,
    protocol: options.ProtocolName = "paper-v1",
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
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Draw lidar, road, lens and flow by ego-motion onto the images of each camera instead; no method.",
        ),
    ] = False,
) -> None:
    """Draw frames: reference and lidar clusters, with --method what it finds; a video, or a log for the viewer."""
    from bench.api.view import view, view_calibration
    from bench.cli.request import rendered_card
    from bench.evaluation import load_protocol
    from bench.harness import build_scorable
    from bench.methods.settings import parse_settings
    from bench.reporting.film import refuse_other_files

    # mistakes are told before anything is rendered
    if method is None and set_:
        raise UsageError("--set: expected --method, whose setting it is, got none")
    built = None if method is None else build_scorable(method, parse_settings(set_))
    load_protocol(protocol)
    if calibration and video is not None:
        raise UsageError("--video: expected none with --calibration, which draws pictures and logs (--out, --rrd)")
    refuse_other_files(video=video, rrd=rrd)
    card = rendered_card(dataset)
    chosen: dict[str, Any] = {
        "recording": recording,
        "camera": camera,
        "frame": frame,
        "frames": frames,
        "time_ns": time_ns,
    }
    with progress_bar(f"drawing {recording or card.name}", "images") as progress:
        chosen |= {"out": out, "rrd": rrd, "progress": progress}
        if calibration:
            found = view_calibration(card, **chosen)
        else:
            found = view(card, **chosen, method=built, protocol=protocol, video=video, lidar=lidar)
    for remark in found.remarks:
        say(remark)
    note_files(found.files)
