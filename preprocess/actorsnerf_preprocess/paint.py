"""Textures of actors, painted in space: colours as a function of each texel's rest position."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float32, Float64, UInt8
from actorsnerf_preprocess.cloth_regions import BOTTOM, HAIR, SHOE, TOP, on_arm, region_of
from actorsnerf_preprocess.outfits import Colour, Fabric, Outfit

MARK_PIXELS = 256
FRONT_MARK = (0.0, 0.085, 0.10)
"""x, y of the middle and half the side, metres; on the chest."""
BACK_MARK = (0.0, 0.05, 0.125)
WEAVE = 0.035
"""Standard deviation of a cloth's fine brightness noise."""
EYE = (0.0276, 0.4196, 0.1313)
"""Middle of the left eyeball at rest."""
WHITE, IRIS, PUPIL = (236, 236, 232), (94, 66, 44), (16, 14, 14)
EYE_RADIUS, IRIS_RADIUS, PUPIL_RADIUS = 0.0150, 0.0062, 0.0028
LIPS = (-0.001, 0.3615)
_BODY_MIDDLE_Z = 0.03


def paint_person(positions: Float32, outfit: Outfit) -> UInt8:
    """The texture (T, T, 3) of body or suit from the rest position of each texel."""
    points = positions.astype(np.float64)
    region = region_of(points, outfit)
    colours = _skin(points, outfit)
    top = _marked(_fabric(points, outfit.top), points, outfit)
    bottom = _fabric(points, outfit.bottom)
    for which, paint in ((TOP, top), (BOTTOM, bottom)):
        colours[region == which] = paint[region == which]
    cloth = (region == TOP) | (region == BOTTOM)
    sole = points[..., 1] < -1.115
    colours[region == SHOE] = outfit.shoes
    colours[(region == SHOE) & sole] = (225, 225, 220)
    hair = region == HAIR
    colours[hair] = _hair(points, outfit.hair)[hair]
    rng = np.random.default_rng(outfit.noise_seed)
    weave = rng.normal(0.0, WEAVE, points.shape[:2])
    colours *= 1.0 + (weave * cloth + _folds(points) * cloth)[..., None]
    return _texture(colours)


def paint_fabric(positions: Float32, fabric: Fabric, noise_seed: int) -> UInt8:
    """The texture (T, T, 3) of a skirt."""
    points = positions.astype(np.float64)
    rng = np.random.default_rng(noise_seed)
    around = np.arctan2(points[..., 0], points[..., 2] - _BODY_MIDDLE_Z)
    pleats = 0.10 * np.sin(24 * around)
    shade = 1.0 + rng.normal(0.0, WEAVE, points.shape[:2]) + pleats
    return _texture(_fabric(points, fabric) * shade[..., None])


def paint_hair(positions: Float32, colour: Colour) -> UInt8:
    """The texture (T, T, 3) of long hair."""
    return _texture(_hair(positions.astype(np.float64), colour))


def _texture(colours: Float64) -> UInt8:
    texture: UInt8 = np.clip(colours, 0, 255).astype(np.uint8)
    return texture


def _fabric(points: Float64, fabric: Fabric) -> Float64:
    """Colours (..., 3) of a fabric laid around torso, arms and legs."""
    along, around = _cloth_coordinates(points)
    a, b = along / fabric.period, around / fabric.period
    match fabric.pattern:
        case "plain":
            second = np.zeros(along.shape, dtype=bool)
        case "hoops":
            second = a % 1 < 0.45
        case "stripes":
            second = b % 1 < 0.4
        case "checks":
            second = (a % 1 < 0.5) ^ (b % 1 < 0.5)
        case "diagonals":
            second = (a + b) % 1 < 0.45
        case "dots":
            second = (a % 1 - 0.5) ** 2 + (b % 1 - 0.5) ** 2 < 0.1
        case "yoke":
            second = (points[..., 1] > 0.07) | on_arm(points)
    return np.where(second[..., None], fabric.second, fabric.colour).astype(np.float64)


def _cloth_coordinates(points: Float64) -> tuple[Float64, Float64]:
    """Metres along and around the nearest of torso, arm and leg."""
    x, y, z = np.moveaxis(points, -1, 0)
    arm, leg = on_arm(points), y < -0.33
    along = np.where(arm, np.abs(x), y)
    torso_around = 0.16 * np.arctan2(x, z - _BODY_MIDDLE_Z)
    arm_around = 0.06 * np.arctan2(y - 0.186, z - _BODY_MIDDLE_Z)
    leg_around = 0.08 * np.arctan2(np.abs(x) - 0.14, z - _BODY_MIDDLE_Z)
    return along, np.where(arm, arm_around, np.where(leg, leg_around, torso_around))


def _marked(colours: Float64, points: Float64, outfit: Outfit) -> Float64:
    """The top with a mark on the chest and another on the back, each on a plain patch."""
    for mark, place, side in (
        (outfit.front_mark, FRONT_MARK, 1.0),
        (outfit.back_mark, BACK_MARK, -1.0),
    ):
        x, y, half = place
        u = (side * points[..., 0] - x) / half
        v = (y - points[..., 1]) / half
        facing = side * (points[..., 2] - _BODY_MIDDLE_Z) > 0
        inside = (np.maximum(np.abs(u), np.abs(v)) < 1) & facing & ~on_arm(points)
        columns = np.clip((u + 1) / 2 * MARK_PIXELS, 0, MARK_PIXELS - 1).astype(int)
        rows = np.clip((v + 1) / 2 * MARK_PIXELS, 0, MARK_PIXELS - 1).astype(int)
        drawn = _mark(mark)[rows, columns]
        patch = inside & (np.hypot(u, v) < 1)
        colours = np.where(patch[..., None], outfit.top.colour, colours)
        colours = np.where((inside & drawn)[..., None], outfit.mark_colour, colours)
    return colours


def _mark(name: str) -> NDArray[np.bool_]:
    """A bool picture of a number, a letter or a simple figure."""
    canvas = np.zeros((MARK_PIXELS, MARK_PIXELS), dtype=np.uint8)
    middle = MARK_PIXELS // 2
    turns = np.arange(10) * np.pi / 5
    radii = np.where(np.arange(10) % 2 == 0, 120, 50)
    figures = {
        "star": np.stack([middle + radii * np.sin(turns), middle - radii * np.cos(turns)], axis=1),
        "diamond": np.array([[128, 8], [228, 128], [128, 248], [28, 128]]),
        "chevron": np.array([[10, 90], [128, 200], [246, 90], [246, 150], [128, 255], [10, 150]]),
        "bar": np.array([[8, 96], [248, 96], [248, 160], [8, 160]]),
    }
    if name in figures:
        cv2.fillPoly(canvas, [figures[name].astype(np.int32)], 1)
    elif name == "ring":
        cv2.circle(canvas, (middle, middle), 90, 1, 44)
    elif name == "cross":
        cv2.line(canvas, (30, 30), (226, 226), 1, 52)
        cv2.line(canvas, (226, 30), (30, 226), 1, 52)
    else:
        size, thickness = 9.0 / max(len(name), 1.3), 56 // (1 + len(name) // 2)
        (width, height), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
        origin = (middle - width // 2, middle + height // 2)
        cv2.putText(canvas, name, origin, cv2.FONT_HERSHEY_SIMPLEX, size, 1, thickness)
    return canvas.astype(bool)


def _skin(points: Float64, outfit: Outfit) -> Float64:
    """Skin with eyes, brows, lips and a little unevenness."""
    x, y, z = np.moveaxis(points, -1, 0)
    skin = np.array(outfit.skin, dtype=np.float64)
    blush = 0.04 * np.sin(31 * x) * np.sin(37 * y) * np.sin(29 * z)
    colours: Float64 = skin * (1.0 + blush[..., None])
    face = z > 0.08
    lips = face & (((x - LIPS[0]) / 0.024) ** 2 + ((y - LIPS[1]) / 0.009) ** 2 < 1)
    colours[lips & (y > 0.2)] = 0.72 * skin * [1.05, 0.75, 0.75]
    across, up = np.abs(x) - EYE[0], y - EYE[1]
    brow = face & (np.abs(across) < 0.019) & (np.abs(up - 0.021) < 0.0045)
    colours[brow] = np.array(outfit.hair) * 0.8
    ball = np.abs(np.sqrt(across**2 + up**2 + (z - EYE[2]) ** 2) - EYE_RADIUS) < 0.0012
    colours[ball & (z > EYE[2])] = (236, 234, 230)
    iris = ball & (np.hypot(across, up) < IRIS_RADIUS) & (z > EYE[2])
    colours[iris] = (52, 40, 34)
    return colours


def _hair(points: Float64, colour: Colour) -> Float64:
    """Hair with strands that run down from the crown."""
    around = np.arctan2(points[..., 0], points[..., 2] - 0.02)
    strands = 0.10 * np.sin(45 * around + 9 * points[..., 1]) + 0.07 * np.sin(97 * around)
    colours: Float64 = np.array(colour, dtype=np.float64) * (1.0 + strands[..., None])
    return colours


def _folds(points: Float64) -> Float64:
    """Slow brightness changes over cloth, as a share."""
    x, y, z = np.moveaxis(points, -1, 0)
    wide: Float64 = 0.05 * np.sin(23 * y + 11 * x) * np.sin(17 * z + 13 * x)
    wide += 0.03 * np.sin(51 * y + 19 * z)
    return wide
