"""Which method made a result, in words and digests: nothing of it is ever imported or called."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from bench.harness.keys import MethodIdentity
from bench.methods import Method, known_methods


class MethodStamp(BaseModel):
    """Which method made the metrics.

    Attributes:
        name: its own.
        settings: every parameter.
        place: "module:Class" of its class; told, and never imported from here. None in runs of older versions.
        history: images that it needs before the one that it segments; None in runs of older versions.
        identity: SHA-256 over its own code, the libraries that this imports and the files that it reads; None in runs
            of older versions, and where nobody took it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]
    place: str | None = None
    history: int | None = None
    identity: str | None = None

    @classmethod
    def of(cls, method: Method, identity: MethodIdentity) -> MethodStamp:
        """The stamp of a method."""
        return cls(
            name=method.name,
            settings=method.settings(),
            place=identity.place,
            history=method.history,
            identity=identity.digest,
        )

    @property
    def called(self) -> str:
        """What `--method` takes for it."""
        return self.name if self.place in {None, known_methods().get(self.name)} else str(self.place)
