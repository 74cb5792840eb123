"""Which method made a result."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from bench.methods import Method, build_method, known_methods


class MethodStamp(BaseModel):
    """Which method made the figures.

    Attributes:
        name: its own.
        settings: every parameter.
        place: "module:Class", by which a method is found that no registry knows; None in runs of older versions.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]
    place: str | None = None

    @classmethod
    def of(cls, method: Method) -> MethodStamp:
        """The stamp of a method."""
        kind = type(method)
        return cls(name=method.name, settings=method.settings(), place=f"{kind.__module__}:{kind.__qualname__}")

    @property
    def called(self) -> str:
        """What `--method` takes for it."""
        return self.name if self.place in {None, known_methods().get(self.name)} else str(self.place)

    def build(self) -> Method:
        """The method again, to look at single frames.

        Raises:
            UnknownNameError: neither the registry nor the place knows it.
            UsageError: it does not take its own settings.
        """
        return build_method(self.called, self.settings)
