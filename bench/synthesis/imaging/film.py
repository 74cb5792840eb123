"""The images of a recording, written one by one."""

from __future__ import annotations

from bench.recordings import MountedCamera, RecordingWriter
from bench.synthesis.driving.host import own_body
from bench.synthesis.imaging.renderer import ImageRenderer, Moment
from bench.synthesis.imaging.textures import texture_atlas
from bench.synthesis.scenario import RecordingSpec, Scenario
from bench.synthesis.scenario.draws import named_rng
from bench.synthesis.stage import FIRST_IMAGE_NS, Stage


def film(
    scenario: Scenario, spec: RecordingSpec, stage: Stage, *, camera: MountedCamera, writer: RecordingWriter
) -> None:
    """Render and write every image of one camera, and the truth beside it; an image's time is mid exposure."""
    sensor = next(entry.sensor for entry in scenario.cameras if entry.name == camera.name)
    renderer = ImageRenderer(
        camera,
        own_body=own_body(),
        world=stage.world,
        atlas=texture_atlas(scenario.seed),
        light=stage.light,
        sensor=sensor,
    )
    exposure_ms = stage.light.shutter_ms if sensor.exposure_ms is None else sensor.exposure_ms
    half_ns = round(exposure_ms * 1e6 / 2)
    for frame, time_ns in enumerate(stage.image_times_ns.tolist()):
        middle = moment(stage, time_ns)
        image = renderer.render(
            middle,
            shutter=(middle, moment(stage, time_ns + half_ns)) if half_ns else None,
            rng=named_rng(scenario.seed, spec.name, camera.name, frame),
        )
        timestamp_ns = time_ns + FIRST_IMAGE_NS
        writer.image(camera.name, timestamp_ns, image.pixels, jpeg_quality=sensor.jpeg_quality)
        writer.truth(camera.name, timestamp_ns, image.instance_ids)


def moment(stage: Stage, time_ns: int) -> Moment:
    """Where everything is at a time of the scene clock."""
    return Moment(
        placed=[actor.placed(time_ns) for actor in stage.actors],
        world_from_vehicle=stage.host.at([time_ns]).transform(),
    )
