import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.cloth_regions import (
    BOTTOM,
    CIHP_ARM,
    CIHP_FACE,
    CIHP_HAIR,
    CIHP_LEG,
    CIHP_SHOE,
    CIHP_TOP,
    CIHP_TORSO,
    CIHP_TROUSERS,
    HAIR,
    SHOE,
    SKIN,
    TOP,
    cihp_labels,
    cloth_depth,
    in_hair,
    on_arm,
    region_of,
)
from actorsnerf_preprocess.free_body import free_body
from actorsnerf_preprocess.outfits import Outfit, draw_outfit

CHEST, THIGH, SHIN = (0.0, 0.05, 0.15), (0.1, -0.45, 0.05), (0.1, -0.8, 0.05)
LEFT_HAND, RIGHT_UPPER_ARM, NOSE = (0.75, 0.18, 0.03), (-0.25, 0.18, 0.03), (0.0, 0.38, 0.17)
CROWN, LEFT_SOLE = (0.0, 0.52, 0.04), (0.1, -1.12, 0.1)


@pytest.fixture
def outfit() -> Outfit:
    """Trousers and a top with short sleeves."""
    rng = np.random.default_rng(0)
    drawn = (draw_outfit(rng, 0, "pretraining") for _ in range(50))
    return next(one for one in drawn if one.bottom_cut == "trousers" and one.sleeve_end < 0.4)


def points(*places: tuple[float, float, float]) -> Float64:
    return np.array(places)


def test_regions_lie_where_clothes_are_worn(outfit: Outfit) -> None:
    places = points(CHEST, THIGH, SHIN, LEFT_HAND, RIGHT_UPPER_ARM, NOSE, CROWN, LEFT_SOLE)
    expected = [TOP, BOTTOM, BOTTOM, SKIN, TOP, SKIN, HAIR, SHOE]
    assert region_of(places, outfit).tolist() == expected


def test_labels_name_parts_of_the_person(outfit: Outfit) -> None:
    places = points(CHEST, THIGH, LEFT_HAND, NOSE, CROWN, LEFT_SOLE)
    expected = [CIHP_TOP, CIHP_TROUSERS, CIHP_ARM[0], CIHP_FACE, CIHP_HAIR, CIHP_SHOE[0]]
    assert cihp_labels(places, outfit).tolist() == expected
    mirrored = cihp_labels(places * [-1, 1, 1], outfit).tolist()
    assert mirrored == [CIHP_TOP, CIHP_TROUSERS, CIHP_ARM[1], CIHP_FACE, CIHP_HAIR, CIHP_SHOE[1]]


def test_every_part_of_the_body_has_a_label(outfit: Outfit) -> None:
    labels = cihp_labels(free_body().template, outfit)
    known = {CIHP_TOP, CIHP_TROUSERS, CIHP_FACE, CIHP_HAIR, CIHP_TORSO}
    known |= {*CIHP_ARM, *CIHP_LEG, *CIHP_SHOE}
    assert set(np.unique(labels).tolist()) <= known
    assert {CIHP_TOP, CIHP_TROUSERS, CIHP_FACE, *CIHP_ARM, *CIHP_SHOE} <= set(labels.tolist())


def test_depth_is_zero_at_the_hem_of_a_sleeve(outfit: Outfit) -> None:
    x = outfit.sleeve_end
    sleeve = points((x - 0.01, 0.18, 0.03), (x, 0.18, 0.03), (-x - 0.02, 0.18, 0.03))
    np.testing.assert_allclose(cloth_depth(sleeve, outfit), [0.01, 0.0, -0.02], atol=1e-12)


def test_arms_are_told_from_legs_and_torso() -> None:
    assert on_arm(points(LEFT_HAND, RIGHT_UPPER_ARM)).all()
    assert not on_arm(points(CHEST, THIGH, NOSE)).any()


def test_ears_and_face_are_not_hairy() -> None:
    assert in_hair(points(CROWN, (0.0, 0.45, -0.07))).all()
    assert not in_hair(points(NOSE, (0.08, 0.40, 0.03), CHEST)).any()
