"""What a sweep is: values, what each changes, and how they are read from the command line."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from bench.errors import UnknownNameError, UsageError
from bench.harness.sweep.trial import Trial

Value = float | int | str
Scale = Literal["linear", "log", "names"]
Part = Literal["method", "reference", "input"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A sweep by name.

    Attributes:
        title: what the values are, with their unit, as the axis of the chart says.
        about: one line for lists.
        part: what a value changes: the method, the reference, or the input that the method is told.
        scale: how the values lie on an axis; "names" for values that are no numbers.
        values: taken by default.
        change: the trial of a value.
        operating: the value that a trial has of itself.
        least: smallest number that makes sense; None without one.
        whole: whole numbers only.
        choices: the names there are; None for any that `change` takes.
    """

    title: str
    about: str
    part: Part
    scale: Scale
    values: tuple[Value, ...]
    change: Callable[[Trial, Value], Trial]
    operating: Callable[[Trial], Value]
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
