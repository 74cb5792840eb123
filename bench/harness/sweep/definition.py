"""What a sweep is: values, what each changes, and how they are read from the command line."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Literal, cast

from pydantic import ValidationError

from bench.errors import UnknownNameError, UsageError
from bench.evaluation import Protocol
from bench.methods import Method
from bench.recordings import NO_INPUT_ERRORS, InputErrors

Value = float | int | str
Scale = Literal["linear", "log", "names"]
Part = Literal["method", "reference", "input"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What the run of one value scores.

    Attributes:
        method: with its settings.
        protocol: the rules.
        input_errors: of what the method is told.
    """

    method: Method
    protocol: Protocol
    input_errors: InputErrors = NO_INPUT_ERRORS

    def parameter(self, name: str) -> Any:
        """A parameter of the method.

        Raises:
            UsageError: the method is not a data class with such a field.
        """
        if not (is_dataclass(self.method) and name in {field.name for field in fields(self.method)}):
            raise UsageError(f"sweep: expected a method with the parameter {name!r}, got {self.method.name!r}")
        return getattr(self.method, name)

    def with_parameters(self, **changes: object) -> Setup:
        """The same with other values of parameters of the method.

        Raises:
            UsageError: the method has no such parameter, or refuses the value.
        """
        for name in changes:
            self.parameter(name)
        return replace(self, method=cast(Method, replace(cast(Any, self.method), **changes)))

    def with_rules(self, **changes: object) -> Setup:
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

    def with_error(self, name: str, value: float) -> Setup:
        """The same with another error of what the method is told."""
        return replace(self, input_errors=replace(self.input_errors, **{name: value}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A sweep by name.

    Attributes:
        title: what the values are, with their unit, as the axis of the chart says.
        about: one line for lists.
        part: what a value changes: the method, the reference, or the input that the method is told.
        scale: how the values lie on an axis; "names" for values that are no numbers.
        values: taken by default.
        change: the setup of a value.
        operating: the value that a setup has of itself.
        least: smallest number that makes sense; None without one.
        whole: whole numbers only.
        choices: the names there are; None for any that `change` takes.
    """

    title: str
    about: str
    part: Part
    scale: Scale
    values: tuple[Value, ...]
    change: Callable[[Setup, Value], Setup]
    operating: Callable[[Setup], Value]
    least: float | None = None
    whole: bool = False
    choices: tuple[str, ...] | None = None

    def parse(self, text: str) -> Value:
        """A value from the command line.

        Raises:
            UsageError: not a number where one is wanted, or out of its domain.
            UnknownNameError: not one of the choices.
        """
        text = text.strip()
        if self.scale == "names":
            if self.choices is not None and text not in self.choices:
                raise UnknownNameError("value", text, self.choices)
            return text
        return self._number(text)

    def _number(self, text: str) -> Value:
        kind = "a whole number" if self.whole else "a number"
        expected = kind if self.least is None else f"{kind} of at least {self.least:g}"
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (self.whole and number != int(number)):
            raise UsageError(f"--values: expected {expected} ({self.title}), got {text!r}")
        if self.least is not None and number < self.least:
            raise UsageError(f"--values: expected {expected} ({self.title}), got {text!r}")
        return int(number) if self.whole else number
