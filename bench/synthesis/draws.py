"""Values that a series draws: every recording of it gets numbers of its own.

Instead of a value of a series stands a mapping with one of these keys:

    {uniform: [a, b]}        any number from a to b
    {choice: [p, q, ...]}    one of these, which may be whole lists or mappings
    {steps: [a, b]}          from a in the first recording of the series to b in the last, evenly
    {each: [p, q, ...]}      the k-th of these in the k-th repeat of an actor
    {value: name}            what `values` of the series calls so
    {sum: [p, q, ...]}       of numbers, drawn or not
    {product: [p, q, ...]}   likewise

Every draw has random numbers of its own, named by the series, the recording's number in it and the position of the draw
in the file: another series, another field or a longer series change nothing in a recording (a longer series moves its
`steps` alone).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

DECIMALS = 4  # of drawn numbers: a tenth of a millimetre


class DrawError(ValueError):
    """A draw that cannot be made.

    Args:
        path: keys on the path to it, from the series on.
        expected: what can stand there.
        got: what does.
    """

    def __init__(self, path: str, expected: str, got: object) -> None:
        self.path, self.expected, self.got = path, expected, repr(got)
        super().__init__(f"{path}: expected {expected}, got {got!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampler:
    """Draws the values of one recording of a series.

    Attributes:
        seed: of the scenario.
        series: name of the series.
        index: of the recording in the series, from 0.
        count: recordings of the series.
        attempt: 0, or how often the recording was drawn before with bodies that overlapped.
        values: the series' named values, drawn where a field asks for them.
    """

    seed: int
    series: str
    index: int
    count: int
    attempt: int = 0
    values: Mapping[str, Any] = field(default_factory=dict)

    def drawn(self, node: Any, path: str, *, repeat: int | None = None) -> Any:
        """A part of the series with every draw replaced by what it gives.

        Args:
            node: the part.
            path: keys on the path to it.
            repeat: number of the repeat that it stands in, from 0.

        Raises:
            DrawError: something that is not a draw.
        """
        if isinstance(node, dict):
            if len(node) == 1 and (kind := next(iter(node))) in DRAWS:
                return DRAWS[kind](self, node[kind], path, repeat)
            return {key: self.drawn(part, f"{path}.{key}", repeat=repeat) for key, part in node.items()}
        if isinstance(node, list):
            return [self.drawn(part, f"{path}.{k}", repeat=repeat) for k, part in enumerate(node)]
        return node

    def number(self, node: Any, path: str, repeat: int | None) -> float:
        """A number, drawn or not."""
        value = self.drawn(node, path, repeat=repeat)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise DrawError(path, "a number", value)
        return value

    def share(self, path: str, repeat: int | None) -> float:
        """The random number of a position in the file, from 0 to 1."""
        names = (self.series, self.index, self.attempt, path, "" if repeat is None else repeat)
        return float(named_rng(self.seed, "series", *names).random())


def _uniform(sampler: Sampler, node: Any, path: str, repeat: int | None) -> float:
    low, high = _two(sampler, node, path, repeat)
    return round(low + (high - low) * sampler.share(path, repeat), DECIMALS)


def _choice(sampler: Sampler, node: Any, path: str, repeat: int | None) -> Any:
    options = _filled(node, path)
    number = int(sampler.share(path, repeat) * len(options))
    return sampler.drawn(options[number], f"{path}.choice.{number}", repeat=repeat)


def _steps(sampler: Sampler, node: Any, path: str, repeat: int | None) -> float:
    low, high = _two(sampler, node, path, repeat)
    return round(low + (high - low) * (sampler.index / max(sampler.count - 1, 1)), DECIMALS)


def _each(sampler: Sampler, node: Any, path: str, repeat: int | None) -> Any:
    options = _filled(node, path)
    if repeat is None or repeat >= len(options):
        raise DrawError(path, f"at most {len(options)} repeats of the actor", "none" if repeat is None else repeat + 1)
    return sampler.drawn(options[repeat], f"{path}.each.{repeat}", repeat=repeat)


def _value(sampler: Sampler, node: Any, path: str, repeat: int | None) -> Any:  # noqa: ARG001
    if not isinstance(node, str) or node not in sampler.values:
        raise DrawError(path, f"a name under values ({', '.join(sampler.values) or 'there are none'})", node)
    rest = {name: value for name, value in sampler.values.items() if name != node}  # so that none can hold itself
    return replace(sampler, values=rest).drawn(sampler.values[node], f"values.{node}")


def _sum(sampler: Sampler, node: Any, path: str, repeat: int | None) -> float:
    parts = _filled(node, path)
    return round(math.fsum(sampler.number(part, f"{path}.sum.{k}", repeat) for k, part in enumerate(parts)), DECIMALS)


def _product(sampler: Sampler, node: Any, path: str, repeat: int | None) -> float:
    parts = _filled(node, path)
    return round(
        math.prod(sampler.number(part, f"{path}.product.{k}", repeat) for k, part in enumerate(parts)), DECIMALS
    )


def _filled(node: Any, path: str) -> list[Any]:
    if not isinstance(node, list) or not node:
        raise DrawError(path, "a list of at least one", node)
    return node


def _two(sampler: Sampler, node: Any, path: str, repeat: int | None) -> tuple[float, float]:
    if not isinstance(node, list) or len(node) != 2:
        raise DrawError(path, "two numbers, [from, to]", node)
    low, high = (sampler.number(part, f"{path}.{k}", repeat) for k, part in enumerate(node))
    return low, high


DRAWS: dict[str, Callable[[Sampler, Any, str, int | None], Any]] = {
    "uniform": _uniform,
    "choice": _choice,
    "steps": _steps,
    "each": _each,
    "value": _value,
    "sum": _sum,
    "product": _product,
}


def named_rng(seed: int, *names: str | int) -> np.random.Generator:
    """A generator of its own for each purpose, the same on every run and in every process.

    Args:
        seed: of the scenario.
        names: what the numbers are for: recording, sensor, frame.
    """
    text = "/".join([str(seed), *map(str, names)])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "little"))
