"""Each model against an independent implementation or numbers worked out by hand; times of rows."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.adapters.woodscape import Intrinsic
from bench.cameras.angular import KannalaBrandtCamera, OcamCamera, RadialPolynomialCamera
from bench.cameras.model import RollingShutter
from bench.cameras.pinhole import BrownDistortion, PinholeCamera
from bench.cameras.spheres import BrownConradyCamera, DoubleSphereCamera, ExtendedUnifiedCamera, UnifiedCamera
from bench.cameras.stored import camera_from_parameters, camera_parameters
from bench.errors import ShapeError
from bench.geometry import normalise
from tests.support.lenses import LENSES, real_kannala_brandt
from tests.support.real import needs_real

SHAPE = {"width": 500, "height": 500, "principal_point": (250, 250)}
FORWARD = np.column_stack([np.random.default_rng(1).uniform(-3, 3, (2000, 2)), np.ones(2000)])
RAYS = np.random.default_rng(3).normal((0.0, 0.0, 0.6), size=(400, 3))


def at_angles(*angles_rad):
    return np.array([[np.sin(angle), 0.0, np.cos(angle)] for angle in angles_rad])


def valid_of(camera, *, rays=(), right_px=()):
    """Which rays the lens maps, or which pixels so far right of the middle it maps back."""
    if len(rays):
        return camera.project(np.asarray(rays, dtype=float))[1].tolist()
    return camera.unproject(np.array([[250.0 + px, 250.0] for px in right_px]))[1].tolist()


def assert_projects(camera, rays, expected, *, within=None):
    """Where the lens maps a ray, it is where the other implementation has it."""
    pixels, valid = camera.project(rays)
    assert valid.mean() > 0.2
    assert within is None or valid[within].all()
    np.testing.assert_allclose(pixels[valid], expected[valid], rtol=1e-9, atol=1e-9)


def opencv_fisheye(rays, matrix, terms):
    none = np.zeros(3)
    return cv2.fisheye.projectPoints(rays[:, None], none, none, matrix, np.asarray(terms))[0].reshape(-1, 2)


def test_kannala_brandt_is_opencvs_fisheye():
    camera = LENSES["kannala_brandt"]
    matrix = np.array([[302.0, 0, 496.6], [0, 320.0, 331.2], [0, 0, 1]])
    assert_projects(camera, FORWARD, opencv_fisheye(FORWARD, matrix, camera.coefficients))


@needs_real
def test_real_kannala_brandt_calibrations_are_opencvs_fisheye():
    for camera, matrix, terms in real_kannala_brandt():
        assert_projects(camera, FORWARD, opencv_fisheye(FORWARD, matrix, terms))


def test_brown_conrady_is_opencvs_pinhole():
    camera = LENSES["brown_conrady"]
    (k1, k2, k3), (p1, p2), none = camera.radial, camera.tangential, np.zeros(3)
    matrix = np.array([[330.0, 0, 325.5], [0, 332.0, 236.0], [0, 0, 1]])
    expected = cv2.projectPoints(FORWARD, none, none, matrix, np.array([k1, k2, p1, p2, k3]))[0][:, 0]
    assert_projects(camera, FORWARD * np.linspace(0.01, 100.0, len(FORWARD))[:, None], expected)


def test_lenses_end_where_the_radius_folds_back_or_at_their_stated_field():
    # r (1 - r^2 / 3) rises up to r = 1, the angle of 45 degrees, where it is 2/3.
    folded = BrownConradyCamera(**SHAPE, focal=(300, 300), radial=(-1 / 3,))
    assert folded.limit_angle_rad == pytest.approx(np.pi / 4)
    assert valid_of(folded, rays=[[0.99, 0, 1], [1.01, 0, 1], [0.5, 0, -1]]) == [True, False, False]
    assert valid_of(folded, right_px=[199.9, 200.1]) == [True, False]
    assert replace(folded, max_angle_rad=0.5).limit_angle_rad == pytest.approx(0.5)
    assert replace(folded, radial=(0.1, 0.0, 0.01)).limit_angle_rad == pytest.approx(np.pi / 2)  # no fold
    # r = 200 theta - 50 theta^2 rises up to theta = 2, where it is 200 px.
    polynomial = RadialPolynomialCamera(**SHAPE, coefficients=(200.0, -50.0))
    assert polynomial.limit_angle_rad == pytest.approx(2.0)
    assert valid_of(polynomial, rays=at_angles(1.99, 2.01)) == [True, False]
    assert valid_of(polynomial, right_px=[199.9, 200.1]) == [True, False]
    stated = RadialPolynomialCamera(**SHAPE, coefficients=(200.0,), max_angle_rad=1.0)
    assert stated.limit_angle_rad == 1.0
    assert valid_of(stated, right_px=[199.0, 201.0]) == [True, False]
    half = KannalaBrandtCamera(**SHAPE, focal=(100, 100), coefficients=(), max_angle_rad=np.pi / 2)
    assert valid_of(half, rays=[[1.0, 0.0, 0.0], [1.0, 0.0, -1e-9]]) == [True, False]  # the limit itself is seen


@pytest.mark.parametrize(
    ("radial", "tangential"),
    [((-0.3, 0.1, -0.02), (2e-3, -1e-3)), ((0.0, 0.0, 0.0), (0.03, 0.04)), ((-0.2, 0.0, 0.0), (0.1, -0.2))],
)
def test_brown_conrady_ends_where_the_distortion_folds_first_in_any_direction(radial, tangential):
    """The determinant of the derivatives, by differences, is positive all around within the limit and not beyond it."""
    distortion = BrownDistortion(radial, tangential, np.inf)
    around = np.linspace(0, 2 * np.pi, 3601)

    def least_determinant(radius, step=1e-5):
        x, y = radius * np.cos(around), radius * np.sin(around)
        left, right, down, up = (
            np.array(distortion(x + dx, y + dy)) for dx, dy in ((-step, 0), (step, 0), (0, -step), (0, step))
        )
        (xx, yx), (xy, yy) = (right - left) / (2 * step), (up - down) / (2 * step)
        return (xx * yy - xy * yx).min()

    assert min(least_determinant(share * distortion.limit) for share in np.linspace(0, 0.999, 50)) > 0
    assert least_determinant(1.001 * distortion.limit) < 0


def test_radial_polynomial_by_hand_with_pixel_centres_and_aspect():
    intrinsic = {"cx_offset": 3.0, "cy_offset": -2.0, "width": 1280.0, "height": 966.0, "aspect_ratio": 1.5}
    intrinsic |= {"model": "radial_poly", "poly_order": 4, "k1": 300.0, "k2": -20.0, "k3": 10.0, "k4": 1.0}
    camera = Intrinsic(**intrinsic).lens(None)
    assert camera.principal_point == (3.0 + 640 - 0.5, -2.0 + 483 - 0.5)
    r = 300 * 1.0 - 20 * 1.0 + 10 + 1  # theta = 1 rad
    ray = [np.sin(1.0) * 0.6, np.sin(1.0) * 0.8, np.cos(1.0)]
    np.testing.assert_allclose(camera.project(np.array([ray]))[0], [[642.5 + 0.6 * r, 480.5 + 1.5 * 0.8 * r]])


def mei_by_the_book(camera, ray):
    """Mei and Rives, one ray at a time, with Brown's distortion as OpenCV prints it."""
    x, y, z = ray / np.linalg.norm(ray)
    x, y = x / (z + camera.xi), y / (z + camera.xi)
    (k1, k2), (p1, p2) = camera.radial, camera.tangential
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return camera.focal[0] * xd + camera.principal_point[0], camera.focal[1] * yd + camera.principal_point[1]


def test_unified_is_mei_by_the_book_and_without_xi_and_distortion_the_pinhole():
    camera, rays = LENSES["unified"], np.random.default_rng(3).normal(size=(200, 3))
    assert_projects(camera, rays, np.array([mei_by_the_book(camera, ray) for ray in rays]))
    plain = UnifiedCamera(width=640, height=480, xi=0.0, focal=(400, 410), principal_point=(319.5, 239.5))
    assert_projects(plain, FORWARD, LENSES["pinhole"].project(FORWARD)[0])
    assert plain.limit_angle_rad == pytest.approx(np.pi / 2)


def double_sphere_by_hand(points, xi, alpha):
    """Equations 40 to 45 of Usenko et al. 2018, for the focal length 1."""
    x, y, z = points.T
    d1 = np.sqrt(x * x + y * y + z * z)
    d2 = np.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
    w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
    return np.stack([x, y], axis=1) / (alpha * d2 + (1 - alpha) * (xi * d1 + z))[:, None], z > -w2 * d1


SPHERE = {"width": 512, "height": 512, "focal": (150.0, 152.0), "principal_point": (255.0, 257.0)}


@pytest.mark.parametrize(
    ("xi", "alpha"), [(-0.17, 0.59), (-0.27, 0.55), (0.0, 0.5), (0.4, 0.3), (0.9, 0.8), (-0.5, 0.2)]
)
def test_double_sphere_as_its_paper_has_it(xi, alpha):
    camera, (plane, within) = DoubleSphereCamera(**SPHERE, xi=xi, alpha=alpha), double_sphere_by_hand(RAYS, xi, alpha)
    assert_projects(camera, RAYS, plane * [150.0, 152.0] + [255.0, 257.0], within=within)
    pixels, valid = camera.project(RAYS)
    back, known = camera.unproject(pixels[valid])
    near = np.abs(pixels[valid]).max(axis=1) < 1e5
    assert known[near].all()
    np.testing.assert_allclose(back[near], normalise(RAYS)[valid][near], atol=1e-6)


@pytest.mark.parametrize(("alpha", "beta"), [(0.59, 1.13), (0.5, 1.0), (0.3, 0.7), (0.8, 2.0), (0.0, 1.0)])
def test_extended_unified_as_its_paper_has_it(alpha, beta):
    camera = ExtendedUnifiedCamera(**SPHERE, alpha=alpha, beta=beta)
    x, y, z = RAYS.T
    d = np.sqrt(beta * (x * x + y * y) + z * z)
    w = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    np.testing.assert_array_equal(camera.project(RAYS)[1], z > -w * d)
    plane = np.stack([x, y], axis=1) / (alpha * d + (1 - alpha) * z)[:, None]
    assert_projects(camera, RAYS, plane * [150.0, 152.0] + [255.0, 257.0])


def test_a_sphere_without_shift_and_stretch_is_the_unified_model():
    lens = {"width": 640, "height": 480, "principal_point": (320.0, 240.0)}
    unified = UnifiedCamera(**lens, focal=(300.0, 300.0), xi=1.5)
    # fx x / (z + xi d) is fx/(1 + xi) x / (alpha d + (1 - alpha) z) with alpha = xi / (1 + xi).
    alpha, focal = 1.5 / 2.5, (300.0 / 2.5, 300.0 / 2.5)
    for same in (
        DoubleSphereCamera(**lens, focal=focal, xi=0.0, alpha=alpha),
        ExtendedUnifiedCamera(**lens, focal=focal, alpha=alpha, beta=1.0),
    ):
        assert same.limit_angle_rad == pytest.approx(unified.limit_angle_rad)
        np.testing.assert_allclose(same.project(RAYS)[0], unified.project(RAYS)[0], rtol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ocam_as_its_toolbox_has_it(sign):
    """`cam2world` of OCamCalib: rows are its x, columns its y, and the affine matrix is [c d; e 1]."""
    c, d, e, centre_row, centre_column = 0.9991, 2e-4, -3e-4, 401.5, 643.5
    polynomial = sign * np.array([-347.0, 0.0, 9.5e-4, -2.1e-7, 6.3e-10])
    lens = {"width": 1280, "height": 800, "principal_point": (centre_column, centre_row)}
    camera = OcamCamera(**lens, coefficients=polynomial, stretch=(1, e, d, c))
    pixels = np.array([[643.5, 401.5], [10.0, 20.0], [1200.0, 700.0], [643.5, 100.0], [900.0, 401.5]])
    rows = np.linalg.inv([[c, d], [e, 1.0]]) @ (pixels[:, ::-1] - [centre_row, centre_column]).T
    depth = np.polyval(polynomial[::-1], np.hypot(*rows))
    seen = np.stack([rows[1], rows[0], depth * np.sign(polynomial[0])], axis=1)
    rays, valid = camera.unproject(pixels)
    assert valid.all()
    np.testing.assert_allclose(rays, seen / np.linalg.norm(seen, axis=1)[:, None], atol=1e-12)
    assert rays[0].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("name", "model"),
    [("mei", "unified"), ("equidistant", "kannala_brandt"), ("plumb_bob", "brown_conrady"), ("ds", "double_sphere"),
     ("EUCM", "extended_unified"), ("scaramuzza", "ocam"), ("radtan", "brown_conrady")],
)  # fmt: skip
def test_names_of_other_tools_lead_to_the_model(name, model):
    stored = camera_parameters(LENSES[model])
    assert camera_from_parameters(**stored | {"model": name}) == LENSES[model]


@pytest.mark.parametrize(
    ("model", "wrong", "told"),
    [
        ("double_sphere", {"xi": -1.0}, "xi: expected a number above -1, got -1.0"),
        ("double_sphere", {"alpha": 1.2}, "alpha: expected a number from 0 to 1, got 1.2"),
        ("extended_unified", {"beta": 0.0}, "beta: expected a positive number, got 0.0"),
        ("ocam", {"coefficients": (0.0, 1.0)}, "coefficients: expected a0 other than 0 first"),
        ("ocam", {"stretch": (1.0, 0.0, 0.0)}, "stretch: expected four numbers of a matrix"),
        ("ocam", {"stretch": (0.0, 1.0, 1.0, 0.0)}, "stretch: expected four numbers of a matrix that mirrors nothing"),
        ("brown_conrady", {"radial": (0.1, 0.2, 0.3, 0.4)}, "radial: expected at most three numbers k1, k2, k3"),
        ("radial_polynomial", {"coefficients": (-1.0, 2.0)}, "positive linear term"),
        ("radial_polynomial", {"coefficients": (np.nan,)}, "finite numbers"),
        ("radial_polynomial", {"aspect_ratio": 0.0}, "aspect_ratio"),
        ("radial_polynomial", {"width": 0}, "image size"),
        ("radial_polynomial", {"max_angle_rad": 4.0}, "max_angle_rad"),
        ("radial_polynomial", {"principal_point": (1.0,)}, "principal_point"),
    ],
)
def test_impossible_lenses_are_refused(model, wrong, told):
    with pytest.raises(ShapeError, match=re.escape(told)):
        camera_from_parameters(**camera_parameters(LENSES[model]) | wrong)


CAMERA = PinholeCamera(width=8, height=4, focal=(5.0, 5.0), principal_point=(3.5, 1.5))
CORNERS = np.array([[0.0, 0.0], [7.0, 0.0], [0.0, 3.0], [7.0, 3.0]])


@pytest.mark.parametrize(
    ("direction", "offsets_ms"),
    [
        ("down", [-15, -15, 15, 15]),  # four rows in 40 ms: 10 ms from row to row
        ("up", [15, 15, -15, -15]),
        ("right", [-17.5, 17.5, -17.5, 17.5]),  # eight columns: 5 ms
        ("left", [17.5, -17.5, 17.5, -17.5]),
    ],
)
def test_the_middle_row_has_the_time_of_the_image(direction, offsets_ms):
    shutter = RollingShutter(readout_s=0.04, direction=direction)
    assert shutter.row_time_offset_s(CORNERS, CAMERA) * 1e3 == pytest.approx(offsets_ms)
    assert shutter.row_time_offset_s(np.array([3.5, 1.5]), CAMERA) == 0.0


def test_rows_of_other_sizes_of_the_image_and_of_pixels_beyond_it():
    """The size at which an image is evaluated changes no time; beyond counts the border, unknown is the image's."""
    shutter, same_places = RollingShutter(readout_s=0.04), (CORNERS + 0.5) * 3 - 0.5
    times_s = shutter.row_time_offset_s(same_places, CAMERA.scaled(24, 12))
    assert times_s == pytest.approx(shutter.row_time_offset_s(CORNERS, CAMERA))
    beyond = np.array([[[0.0, -100.0], [0.0, 100.0], [np.nan, np.nan]]])
    assert shutter.row_time_offset_s(beyond, CAMERA) == pytest.approx(np.array([[-0.02, 0.02, 0.0]]))


@pytest.mark.parametrize("wrong", [{"readout_s": 0.0}, {"readout_s": 25.0}, {"readout_s": np.nan}, {"direction": "in"}])
def test_what_is_no_readout_is_refused(wrong):
    with pytest.raises(ShapeError, match=next(iter(wrong))):
        RollingShutter(**({"readout_s": 0.025} | wrong))
