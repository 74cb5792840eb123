"""Method that made a result, in words and digests; it is never imported or called."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import UsageError
from bench.harness.code_state import method_commit
from bench.harness.digests import MethodCode
from bench.methods import METHODS, Scorable, build_method, known_methods


class MethodOfRun(BaseModel):
    """Method that made the metrics.

    Attributes:
        name: its own.
        settings: every parameter, as the method reports them.
        asked: parameters that the user named, as they were asked for.
        place: "module:Class" of its class; recorded only, never imported from here.
        history: images that it needs before the one that it segments.
        code_digest: SHA-256 over its own code, the libraries that this imports and the files that it reads.
        commit: of the checkout that its own code is of, "+" behind it where a file of it is not as committed; None for
            a method of this package, and for code in no commit. It decides nothing.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]
    asked: dict[str, object] = Field(default_factory=dict)
    place: str
    history: int
    code_digest: str
    commit: str | None = None

    @classmethod
    def of(
        cls, method: Scorable, method_code: MethodCode, *, asked: Mapping[str, object] = MappingProxyType({})
    ) -> MethodOfRun:
        """Record a method in this process."""
        return cls(
            name=method.name,
            settings=method.settings(),
            asked=dict(asked),
            place=method_code.place,
            history=method.history,
            code_digest=method_code.digest,
            commit=method_commit(method_code),
        )

    @property
    def is_own(self) -> bool:
        """It is of this package."""
        return self.place.startswith("bench.")

    @property
    def called(self) -> str:
        """Value of `--method` that selects it."""
        return self.name if self.place == known_methods().get(self.name) else self.place

    def options(self) -> list[str]:
        """The options of a command that ask for it: `--method`, and `--set` for each setting that is not its default.

        Of a method that is not of this package the defaults are unknown, since nothing that a stored file names is
        imported; all of its settings are said.
        """
        words = ["--method", self.called]
        for name, value in self.changed_settings().items():
            words += ["--set", f"{name}={json.dumps(value)}"]
        return words

    def changed_settings(self) -> dict[str, object]:
        """The settings that are not the method's defaults, by dotted name; all of them where these are unknown."""
        try:
            defaults = flat_settings(build_method(self.called).settings()) if self.called in METHODS else {}
        except UsageError:  # its extra is not installed
            defaults = {}
        flat = flat_settings(self.settings)
        return {name: value for name, value in flat.items() if name not in defaults or defaults[name] != value}


def flat_settings(settings: Mapping[str, object], parent: str = "") -> dict[str, object]:
    """A method's settings with dots for what lies deeper, for example "weights.epipolar", as `--set` takes them."""
    flat: dict[str, object] = {}
    for name, value in settings.items():
        if isinstance(value, Mapping) and value:
            flat |= flat_settings(value, f"{parent}{name}.")
        else:
            flat[f"{parent}{name}"] = value
    return flat
