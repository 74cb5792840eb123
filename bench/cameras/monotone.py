"""A polynomial without constant term on the stretch where it rises, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError

NODES = 128  # a search in more costs more than the steps that they save
NODES_WITHOUT_LIMIT = 4096
NEWTON_STEPS = 2
LARGEST = 100.0  # end of the table where neither the polynomial nor its domain has one


@dataclass(frozen=True, slots=True, eq=False)
class MonotonePolynomial:
    """`f(x) = x (c0 + c1 x^step + c2 x^(2 step) + ...)` for x in [0, limit], where f' > 0.

    Attributes:
        coefficients: c0, c1, ...; c0 must be positive.
        step: 1 for every power (the radial polynomial), 2 for odd powers (Kannala-Brandt, radial distortion).
        domain: the largest x of interest; may be infinite.
        limit: first zero of the derivative, or `domain` where there is none before it.
        top: f(limit), the largest value that has an inverse.

    Raises:
        ShapeError: the polynomial does not rise at 0.
    """

    coefficients: tuple[float, ...]
    step: int
    domain: float
    limit: float = field(init=False)
    top: float = field(init=False)
    _nodes: NDArray[np.float64] = field(init=False, repr=False)
    _values: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.coefficients).all() and self.coefficients[0] > 0):
            raise ShapeError(
                f"camera model: expected finite coefficients with a positive linear term, got {self.coefficients}"
            )
        object.__setattr__(self, "limit", min(self._first_fold(), self.domain))
        nodes = self._places()
        object.__setattr__(self, "_nodes", nodes)
        object.__setattr__(self, "_values", self(nodes))
        object.__setattr__(self, "top", float(self._values[-1]) if np.isfinite(self.limit) else np.inf)

    def __call__(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Evaluate; no check of the limit."""
        power = x if self.step == 1 else x * x
        return x * _horner(self.coefficients, power)

    def derivative(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slope at `x`."""
        power = x if self.step == 1 else x * x
        return _horner([c * (1 + self.step * i) for i, c in enumerate(self.coefficients)], power)

    def inverse(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """x with f(x) = y, by table and Newton's method; clamped to [0, limit].

        Beyond f(limit) the result is the limit: the caller marks it as not valid.
        """
        if len(self.coefficients) == 1:
            return np.minimum(y / self.coefficients[0], self.limit)
        x = np.interp(y, self._values, self._nodes)
        for _ in range(NEWTON_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                x -= (self(x) - y) / self.derivative(x)
            np.clip(x, 0.0, self.limit, out=x)
        return x

    def _places(self) -> NDArray[np.float64]:
        """Nodes of the table, denser towards the limit: where the polynomial folds, its inverse rises ever steeper."""
        if self.limit > LARGEST:
            return np.linspace(0.0, LARGEST, NODES_WITHOUT_LIMIT)
        return self.limit * (1.0 - np.linspace(1.0, 0.0, NODES) ** 2)

    def _first_fold(self) -> float:
        slope = [c * (1 + self.step * i) for i, c in enumerate(self.coefficients)]
        roots = np.polynomial.Polynomial(slope).roots()
        real = roots[np.abs(roots.imag) < 1e-9 * np.maximum(1.0, np.abs(roots.real))].real
        positive = real[real > 0]
        return float(positive.min()) ** (1.0 / self.step) if positive.size else float("inf")


def _horner(coefficients: tuple[float, ...] | list[float], x: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        total *= x
        total += coefficient
    return total
