"""One value of a sweep: what is scored, by which rules, with which errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.harness.sweep.perturb import NONE, Injection
from bench.methods import Method
from bench.methods.spherical.method import SphericalMethod


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What is scored together for one value.

    Attributes:
        method: with its settings.
        protocol: the rules.
        injection: errors of the method's input.
    """

    method: Method
    protocol: Protocol
    injection: Injection = NONE

    @property
    def spherical(self) -> SphericalMethod:
        """The method, whose parameters are to change.

        Raises:
            UsageError: another method.
        """
        if not isinstance(self.method, SphericalMethod):
            raise UsageError(f"this sweep changes the method 'spherical', got {self.method.name!r}")
        return self.method

    def with_method(self, **changes: Any) -> Trial:
        """The same with other parameters of the spherical method."""
        changed: Method = replace(self.spherical, **changes)  # type: ignore[assignment]  # its class variables
        return replace(self, method=changed)

    def with_rules(self, **changes: object) -> Trial:
        """The same with other rules of the reference.

        Raises:
            UsageError: a value that the protocol does not take.
        """
        content = self.protocol.model_dump(exclude_unset=True)
        content["reference"] |= changes
        try:
            return replace(self, protocol=Protocol.model_validate(content))  # not a copy: it carries an old digest
        except ValidationError as error:
            first = error.errors()[0]
            raise UsageError(f"protocol: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error

    def with_error(self, **changes: float) -> Trial:
        """The same with other errors of the method's input."""
        return replace(self, injection=replace(self.injection, **changes))
