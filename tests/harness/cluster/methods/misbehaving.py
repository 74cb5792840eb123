"""Methods that meet with what happens on clusters. The folder of this file is on the workers' PYTHONPATH."""

import os
import signal
from pathlib import Path
from time import sleep

from bench.methods import Method, Segmentation


class Bright(Method):
    """Bright pixels; something happens once before the first image of the recording `where`."""

    name = "bright"

    def __init__(self, *, folder: str, where: str = "standing", happening: str = "nothing") -> None:
        self.folder, self.where, self.happening = folder, where, happening

    def segment(self, frame):
        if frame.recording == self.where:
            getattr(self, f"_{self.happening}")()
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > 150)

    def _nothing(self) -> None:
        pass

    def _killed(self) -> None:
        """This process is killed at its first image, and never again."""
        mark = Path(self.folder) / "killed"
        if not mark.exists():
            mark.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)

    def _aborts(self) -> None:
        """The interpreter crashes, always."""
        with (Path(self.folder) / "attempts").open("a") as file:
            file.write("x")
        os.abort()

    def _without_scheduler(self) -> None:
        """The scheduler is killed once another unit is stored."""
        folder = Path(self.folder)
        mark = folder / "scheduler-pid"
        if mark.exists():
            while not list((folder / "run" / "units").glob("*.unit")):
                sleep(0.05)
            os.kill(int(mark.read_text()), signal.SIGKILL)
            mark.unlink()
            sleep(3600)

    def _sleeps(self) -> None:
        (Path(self.folder) / "asleep").touch()
        sleep(3600)

    def _wrong(self) -> None:
        raise ZeroDivisionError("a bug of the method")
