import dataclasses

import numpy as np
import pytest

from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.cloth_regions import HAIR, SHOE, SKIN, TOP, region_of
from actorsnerf_preprocess.outfits import Fabric, Outfit, draw_outfit
from actorsnerf_preprocess.paint import EYE, FRONT_MARK, paint_fabric, paint_hair, paint_person


@pytest.fixture
def outfit() -> Outfit:
    return draw_outfit(np.random.default_rng(0), 0, "pretraining")


@pytest.fixture
def positions(rng: np.random.Generator) -> Float32:
    """Texels at seeded places all over the body."""
    places = rng.uniform([-0.8, -1.13, -0.08], [0.8, 0.52, 0.2], (64, 64, 3))
    return places.astype(np.float32)


def row(*places: tuple[float, float, float]) -> Float32:
    return np.array([places], np.float32)


def plain(outfit: Outfit) -> Outfit:
    return dataclasses.replace(
        outfit, top=Fabric("plain", (200, 40, 40), (0, 0, 0), 0.1), mark_colour=(20, 240, 20)
    )


def mean_colour(texture: UInt8) -> list[float]:
    return [float(channel) for channel in texture.reshape(-1, 3).mean(axis=0)]


def test_the_same_outfit_paints_the_same_texture(positions: Float32, outfit: Outfit) -> None:
    first = paint_person(positions, outfit)
    np.testing.assert_array_equal(first, paint_person(positions, outfit))
    assert first.dtype == np.uint8
    assert first.shape == positions.shape
    other = draw_outfit(np.random.default_rng(1), 1, "pretraining")
    assert (first != paint_person(positions, other)).mean() > 0.3


def test_each_region_has_its_colour(positions: Float32, outfit: Outfit) -> None:
    worn = plain(outfit)
    texture = paint_person(positions, worn)
    region = region_of(positions.astype(np.float64), worn)
    upper = positions[..., 1] < 0.3
    for which, colour in (
        (TOP, worn.top.colour),
        (SKIN, worn.skin),
        (HAIR, worn.hair),
        (SHOE, worn.shoes),
    ):
        chosen = (region == which) & (upper | (which == HAIR)) & (positions[..., 1] > -1.115)
        if which == TOP:
            chosen &= positions[..., 1] < -0.1  # below the marks
        np.testing.assert_allclose(mean_colour(texture[chosen]), colour, atol=12)


def test_a_mark_is_on_the_chest_and_not_on_the_back(outfit: Outfit) -> None:
    worn = dataclasses.replace(plain(outfit), front_mark="bar", back_mark="ring")
    x, y, half = FRONT_MARK
    chest, beside = (x, y, 0.15), (x, y + 1.2 * half, 0.15)
    texture = paint_person(row(chest, beside, (x, 0.05, -0.1)), worn).astype(int)[0]
    assert texture[0, 1] > texture[0, 0] + 100  # the mark's green
    for texel in texture[1:]:
        assert texel[0] > texel[1] + 100  # the cloth's red; the middle of a ring is empty


def test_the_eyes_are_white_with_a_dark_middle(outfit: Outfit) -> None:
    x, y, z = EYE
    radius = 0.0150
    front = (x, y, z + radius)
    side = np.array([0.009, 0.0, np.sqrt(radius**2 - 0.009**2)])
    white = (x + float(side[0]), y, z + float(side[2]))
    texture = paint_person(row(front, white), outfit).astype(int)[0]
    assert texture[0].max() < 120
    assert texture[1].min() > 200


def test_stripes_repeat_with_their_period(outfit: Outfit) -> None:
    hoops = Fabric("hoops", (255, 255, 255), (0, 0, 0), 0.1)
    heights = np.linspace(-0.5, -0.3, 400)
    places = np.stack([np.full(400, 0.3), heights, np.full(400, 0.03)], axis=-1)
    bright = paint_fabric(places[None].astype(np.float32), hoops, outfit.noise_seed)[0, :, 0] > 128
    assert 0.45 < bright.mean() < 0.65
    np.testing.assert_array_equal(bright[:199], bright[200:399])


@pytest.mark.parametrize(
    "pattern", ["plain", "hoops", "stripes", "checks", "diagonals", "dots", "yoke"]
)
def test_every_pattern_can_be_woven(pattern: str, positions: Float32) -> None:
    fabric = Fabric(pattern, (250, 0, 0), (0, 0, 250), 0.08)  # type: ignore[arg-type] # drawn from the list
    texture = paint_fabric(positions, fabric, 3)
    share = (texture[..., 2] > texture[..., 0]).mean()
    assert share == 0 if pattern == "plain" else 0.05 < share < 0.95


def test_hair_has_strands_of_its_colour(positions: Float32) -> None:
    texture = paint_hair(positions, (100, 80, 60))
    np.testing.assert_allclose(mean_colour(texture), (100, 80, 60), rtol=0.05)
    assert texture[..., 0].std() > 3
