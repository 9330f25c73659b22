"""What a synthetic actor wears: seeded draws of cuts, fabrics, marks, hair and skin.

Held-out actors wear fabrics, colours and marks that no pre-training actor wears, so that a picture
of them cannot be remembered. Lengths are metres on the free body at rest, in its own frame.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from actorsnerf_datasets.types import Role

Colour = tuple[int, int, int]
Pattern = Literal["plain", "hoops", "checks", "yoke", "stripes", "dots", "diagonals"]
HairStyle = Literal["cropped", "full", "bun", "bob", "long"]
BottomCut = Literal["trousers", "shorts", "skirt"]

PATTERNS: dict[Role, tuple[Pattern, ...]] = {
    "pretraining": ("hoops", "checks", "yoke", "plain"),
    "held_out": ("diagonals", "dots", "stripes"),
}
MARKS: dict[Role, tuple[str, ...]] = {
    "pretraining": ("7", "star", "12", "ring", "A", "bar", "31", "cross"),
    "held_out": ("84", "chevron", "Q", "diamond"),
}
COLOURS: dict[Role, tuple[Colour, ...]] = {
    "pretraining": (
        (196, 44, 48),
        (36, 84, 170),
        (238, 232, 220),
        (40, 124, 74),
        (232, 186, 46),
        (44, 46, 54),
        (120, 62, 130),
        (150, 154, 160),
    ),
    "held_out": ((226, 108, 36), (28, 150, 156), (236, 214, 196), (150, 30, 84), (30, 40, 86)),
}
SKINS: tuple[Colour, ...] = (
    (236, 194, 166),
    (222, 174, 138),
    (196, 144, 106),
    (158, 108, 76),
    (118, 78, 54),
    (86, 56, 42),
)
HAIRS: tuple[Colour, ...] = (
    (28, 22, 20),
    (62, 40, 26),
    (112, 72, 40),
    (176, 134, 78),
    (128, 124, 122),
)
SHOES: tuple[Colour, ...] = ((34, 34, 38), (232, 232, 228), (150, 52, 44), (60, 84, 120))
LEG_END = {"trousers": -1.035, "shorts": -0.56, "skirt": -0.40}
"""Height where the leg's cloth ends; under a skirt there are short tights."""


@dataclass(frozen=True)
class Fabric:
    """A pattern in two colours."""

    pattern: Pattern
    colour: Colour
    second: Colour
    period: float
    """Metres after which the pattern repeats."""


@dataclass(frozen=True)
class Outfit:
    """All that is visible of an actor besides the body's shape."""

    skin: Colour
    hair: Colour
    hair_style: HairStyle
    top: Fabric
    bottom: Fabric
    bottom_cut: BottomCut
    shoes: Colour
    front_mark: str
    back_mark: str
    mark_colour: Colour
    sleeve_end: float
    """Distance from the body's middle plane where sleeves end."""
    top_hem: float
    """Height of the top's lower edge."""
    top_ease: float
    """Gap between body and top."""
    bottom_ease: float
    """Gap between body and trousers."""
    noise_seed: int
    """Of the cloth's weave."""

    @property
    def leg_end(self) -> float:
        """Height where the leg's cloth ends."""
        return LEG_END[self.bottom_cut]


def draw_outfit(rng: np.random.Generator, index: int, role: Role) -> Outfit:
    """An outfit; `index` spreads fabrics, trousers, marks and hair over the actors of one role."""
    colours = COLOURS[role]
    third = (3 * index + 1) % len(colours)
    others = [number for number in rng.permutation(len(colours)) if number != third]
    first, second, fourth = others[:3]
    marks = MARKS[role]
    styles: tuple[HairStyle, ...] = ("cropped", "long", "full", "bob", "bun")
    cuts: tuple[BottomCut, ...] = ("trousers", "shorts", "trousers", "skirt")
    patterns = PATTERNS[role]
    long_sleeves = rng.random() < 0.4
    return Outfit(
        skin=SKINS[(index * 5 + int(rng.integers(2))) % len(SKINS)],
        hair=HAIRS[int(rng.integers(len(HAIRS)))],
        hair_style=styles[(index + (role == "held_out")) % len(styles)],
        top=Fabric(
            patterns[index % len(patterns)],
            colours[first],
            colours[second],
            float(rng.uniform(0.07, 0.12)),
        ),
        bottom=Fabric(
            "plain" if rng.random() < 0.6 else patterns[(index + 1) % len(patterns)],
            colours[third],
            colours[fourth],
            float(rng.uniform(0.08, 0.14)),
        ),
        bottom_cut=cuts[(index + 2 * (role == "held_out")) % len(cuts)],
        shoes=SHOES[int(rng.integers(len(SHOES)))],
        front_mark=marks[(2 * index) % len(marks)],
        back_mark=marks[(2 * index + 1) % len(marks)],
        mark_colour=_contrasting(colours[first]),
        sleeve_end=float(rng.uniform(0.58, 0.62) if long_sleeves else rng.uniform(0.27, 0.36)),
        top_hem=float(rng.uniform(-0.27, -0.18)),
        top_ease=float(rng.uniform(0.010, 0.022)),
        bottom_ease=float(rng.uniform(0.006, 0.016)),
        noise_seed=int(rng.integers(2**31)),
    )


def _contrasting(colour: Colour) -> Colour:
    """Nearly black on light cloth, nearly white on dark cloth."""
    return (24, 24, 28) if sum(colour) > 380 else (244, 242, 236)
