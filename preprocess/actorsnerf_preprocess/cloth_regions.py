"""Which part of the body at rest is covered by what: one rule for paint, for cut and for labels.

Points are (..., 3) on the free body at rest, in its own frame, metres: x to the person's left, y up
(soles at -1.13, hips -0.27, shoulders 0.19, crown 0.53), z to the front.
"""

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.outfits import Outfit

SKIN, TOP, BOTTOM, SHOE, HAIR = range(5)
COLLAR = 0.245
COLLAR_HALF_WIDTH = 0.085
SHOE_TOP = -1.045
ARM_ROOT = 0.185
ARM_UNDERSIDE = 0.06
HAIRLINE_Z = (-0.08, 0.0, 0.045, 0.085, 0.12)
HAIRLINE_Y = (0.325, 0.345, 0.40, 0.462, 0.478)
EAR_X, EAR_Y = 0.069, 0.425
CIHP_HAIR, CIHP_TOP, CIHP_TROUSERS, CIHP_TORSO, CIHP_SKIRT, CIHP_FACE = 2, 5, 9, 10, 12, 13
"""Part labels of the CIHP data set, which ZJU-MoCap's masks use."""
CIHP_ARM, CIHP_LEG, CIHP_SHOE = (14, 15), (16, 17), (18, 19)
"""Left and right."""
_CHIN, _HIPS = 0.29, -0.3


def on_arm(points: Float64) -> NDArray[np.bool_]:
    """Whether points belong to an arm."""
    return (np.abs(points[..., 0]) > ARM_ROOT) & (points[..., 1] > ARM_UNDERSIDE)


def in_hair(points: Float64) -> NDArray[np.bool_]:
    """Whether points lie on the hairy part of the head."""
    x, y, z = np.moveaxis(points, -1, 0)
    ear = (np.abs(x) > EAR_X) & (y < EAR_Y)
    above: NDArray[np.bool_] = y > np.interp(z, HAIRLINE_Z, HAIRLINE_Y)
    hairy: NDArray[np.bool_] = above & ~ear
    return hairy


def cloth_depth(points: Float64, outfit: Outfit) -> Float64:
    """How far inside the clothes' outline points are, metres; negative outside."""
    x, y, z = np.moveaxis(points, -1, 0)
    collar = COLLAR + np.where(z < 0.0, 0.02, -0.012) - y
    collar = np.where(np.abs(x) < COLLAR_HALF_WIDTH, collar, 1.0)
    sleeve = np.where(on_arm(points), outfit.sleeve_end - np.abs(x), 1.0)
    depth: Float64 = np.minimum(np.minimum(collar, sleeve), y - outfit.leg_end)
    return np.where(y > 0.28, -1.0, depth)


def region_of(points: Float64, outfit: Outfit) -> UInt8:
    """SKIN, TOP, BOTTOM, SHOE or HAIR for each point."""
    y = points[..., 1]
    region = np.full(points.shape[:-1], SKIN, dtype=np.uint8)
    dressed = cloth_depth(points, outfit) > 0
    region[dressed & (y > outfit.top_hem)] = TOP
    region[dressed & (y <= outfit.top_hem)] = BOTTOM
    region[y < SHOE_TOP] = SHOE
    region[in_hair(points)] = HAIR
    return region


def cihp_labels(points: Float64, outfit: Outfit) -> UInt8:
    """CIHP part labels of points."""
    x, y, _ = np.moveaxis(points, -1, 0)
    right = (x < 0).astype(np.uint8)
    region = region_of(points, outfit)
    labels = np.full(points.shape[:-1], CIHP_TORSO, dtype=np.uint8)
    for where, label in (
        (y > _CHIN, CIHP_FACE),
        (on_arm(points), np.array(CIHP_ARM)[right]),
        (y < _HIPS, np.array(CIHP_LEG)[right]),
        (region == TOP, CIHP_TOP),
        (region == BOTTOM, CIHP_TROUSERS),
        (region == HAIR, CIHP_HAIR),
        (region == SHOE, np.array(CIHP_SHOE)[right]),
    ):
        labels = np.where(where, label, labels).astype(np.uint8)
    return labels
