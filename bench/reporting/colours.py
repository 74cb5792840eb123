"""The colours of every picture: Okabe and Ito's, which stay apart for colour-blind readers.

Source:
    Okabe and Ito 2008, Color Universal Design.
"""

from __future__ import annotations

from bench.reference.records import Category

BLACK = "#000000"
ORANGE = "#e69f00"
SKY_BLUE = "#56b4e9"
GREEN = "#009e73"
YELLOW = "#f0e442"
BLUE = "#0072b2"
VERMILION = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#999999"
LIGHT_GREY = "#d9d9d9"

TRUE_POSITIVE = GREEN
FALSE_NEGATIVE = SKY_BLUE
FALSE_POSITIVE = VERMILION

# Never the green of a mask; orange and vermilion do not meet, since the host either stands or drives.
CATEGORY_COLOURS = {
    Category.CROSSING: YELLOW,
    Category.OVERTAKING: SKY_BLUE,
    Category.PRECEDING: VERMILION,
    Category.APPROACHING: PURPLE,
    Category.STATIC_EGO: ORANGE,
    Category.MOVING: BLUE,
}


def category_colour(category: Category | None) -> str:
    """Colour of a kind of motion; grey where it is unknown."""
    return GREY if category is None else CATEGORY_COLOURS[category]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of "#rrggbb", 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
