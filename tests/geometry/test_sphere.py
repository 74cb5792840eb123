import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bench.geometry import angle_between, cross, dot, normalise

vectors = arrays(np.float64, (4, 3), elements=st.floats(-10, 10))


@given(vectors, vectors)
def test_cross_and_dot_are_numpys(a, b):
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-12)
    np.testing.assert_allclose(dot(a, b), (a * b).sum(axis=-1), atol=1e-12)


def test_small_angles_survive():
    a, b = np.array([0.0, 0.0, 1.0]), np.array([1e-9, 0.0, 1.0])
    assert abs(angle_between(a, b) - 1e-9) < 1e-20
    assert angle_between(a, -a) == np.pi


def test_zero_vector_has_no_direction():
    assert np.isnan(normalise(np.zeros(3))).all()
    np.testing.assert_allclose(normalise(np.array([0.0, 3.0, 4.0])), [0, 0.6, 0.8])
