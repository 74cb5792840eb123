"""Figures inside a page: SVG that takes the page's ink and paper, so that it reads in light and in dark."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.reporting.canvas import figure_bytes

_JPEG_QUALITY = 82
_INK = re.compile("#000000|#303030")


def inline_svg(figure: Figure, *, name: str, label: str) -> Markup:
    """A figure as an `<svg>` element.

    Black becomes the page's text colour and white its background; ids carry the name, so that two figures on one page
    do not meet.

    Args:
        figure: drawn in black on white.
        name: of letters, digits and dashes, used once on a page.
        label: says in words what the figure shows.
    """
    text = figure_bytes(figure, "svg").decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(
        r'<(g|path) id="(?:figure|axes|patch|matplotlib|line2d|text|xtick|ytick|legend|Quad)[^"]*"', r"<\1", text
    )
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", text)
    text = _INK.sub("currentColor", text).replace("#ffffff", "var(--paper)")
    head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", text[: text.index(">")])
    opened = f'{head} class="chart" role="img" aria-label="{escape(label)}" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return Markup(opened + text[text.index(">") :])  # matplotlib escapes its texts


def jpeg_uri(image: NDArray[np.uint8]) -> str:
    """A BGR image as a `data:` address."""
    found, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    assert found, "OpenCV writes JPEG"
    return "data:image/jpeg;base64," + base64.b64encode(content.tobytes()).decode()


def figure_uri(figure: Figure, *, scale: float = 1.0) -> str:
    """A figure as a `data:` address, for pictures with photographs in them."""
    image = cv2.imdecode(np.frombuffer(figure_bytes(figure, "png"), dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None, "matplotlib writes PNG"
    if scale != 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return jpeg_uri(np.asarray(image, dtype=np.uint8))
