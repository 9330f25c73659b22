import dataclasses

import numpy as np
import pytest

from actorsnerf_datasets.body_box import box_mask
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.patches import PERSON_SHARE, PatchScene, draw_patches

SIZE = (40, 30)
BOX = np.array([[-1.0, -1.0, 9.0], [1.0, 1.0, 11.0]])


@pytest.fixture
def scene() -> PatchScene:
    """A person of 4x6 pixels in the middle of a box of about 20x20, in a crop of 40x30."""
    alpha = np.zeros(SIZE[::-1], np.uint8)
    alpha[12:18, 18:22] = 1  # the faintest alpha is person
    K = np.array([[90.0, 0.0, 19.5], [0.0, 90.0, 14.5], [0.0, 0.0, 1.0]])
    return PatchScene(alpha, K, np.eye(4), BOX, (0, 0), SIZE)


def centres(rng: np.random.Generator, scene: PatchScene, count: int) -> np.ndarray:
    """Patches of one pixel are their centres."""
    return draw_patches(rng, scene, count, 1)[:, 0, 0]


def test_shape_and_order_of_pixels(rng: np.random.Generator, scene: PatchScene) -> None:
    patches = draw_patches(rng, scene, 3, 8)
    assert patches.shape == (3, 8, 8, 2)
    assert (patches[:, :, 1:, 0] - patches[:, :, :-1, 0] == 1).all()  # x runs along the columns
    assert (patches[:, 1:, :, 1] - patches[:, :-1, :, 1] == 1).all()
    assert (patches[:, 1:, :, 0] == patches[:, :-1, :, 0]).all()


def test_four_fifths_lie_on_the_person(rng: np.random.Generator, scene: PatchScene) -> None:
    found = centres(rng, scene, 2000)
    on_person = scene.alpha[found[:, 1], found[:, 0]] > 0
    assert on_person.mean() == pytest.approx(PERSON_SHARE, abs=4 * np.sqrt(0.16 / 2000))


def test_the_others_are_uniform_over_the_box_without_the_person(
    rng: np.random.Generator, scene: PatchScene
) -> None:
    found = centres(rng, scene, 12000)
    mask = box_mask(SIZE, scene.K, scene.camera_from_body, scene.box)
    for where in (scene.alpha > 0, mask & (scene.alpha == 0)):
        counts = np.zeros(where.shape)
        np.add.at(counts, (found[:, 1], found[:, 0]), 1)
        inside = counts[where]
        assert (inside > 0).mean() > 0.97
        expected = inside.mean()
        chi_squared = float(((inside - expected) ** 2 / expected).sum())
        assert abs(chi_squared - len(inside)) < 5 * np.sqrt(2 * len(inside))
    assert (mask | (scene.alpha > 0))[found[:, 1], found[:, 0]].all()


def test_patches_stay_inside_the_crop(rng: np.random.Generator, scene: PatchScene) -> None:
    patches = draw_patches(rng, scene, 200, 24)
    assert patches.min() == 0
    assert patches[..., 0].max() <= 39 and patches[..., 1].max() == 29
    whole = draw_patches(rng, scene, 2, 30)
    assert (whole[:, 0, 0, 1] == 0).all()


def test_patches_stay_inside_the_picture(rng: np.random.Generator, scene: PatchScene) -> None:
    # The picture holds columns 16 to 27 and rows 9 to 22 of the crop, all inside the box.
    cut = dataclasses.replace(scene, offset=(-16, -9), full_size=(12, 14))
    for side in (1, 5, 12):
        patches = draw_patches(rng, cut, 400, side)
        assert patches.min(axis=(0, 1, 2)).tolist() == [16, 9]
        assert patches.max(axis=(0, 1, 2)).tolist() == [27, 22]


def test_a_patch_wider_than_what_the_picture_holds_hangs_over_as_little_as_it_can(
    rng: np.random.Generator, scene: PatchScene
) -> None:
    cut = dataclasses.replace(scene, offset=(-16, 0), full_size=(6, 30))  # columns 16 to 21
    corners = draw_patches(rng, cut, 200, 10)[:, 0, 0]
    assert (corners[:, 0].min(), corners[:, 0].max()) == (12, 16)
    cut = dataclasses.replace(scene, offset=(36, 0), full_size=(39, 30))  # columns 0 to 2
    cut = dataclasses.replace(cut, alpha=np.roll(scene.alpha, -18, axis=1))
    assert (draw_patches(rng, cut, 50, 10)[:, 0, 0, 0] == 0).all()


def test_without_a_person_the_box_is_taken(rng: np.random.Generator, scene: PatchScene) -> None:
    empty = dataclasses.replace(scene, alpha=np.zeros_like(scene.alpha))
    found = centres(rng, empty, 50)
    assert box_mask(SIZE, scene.K, scene.camera_from_body, BOX)[found[:, 1], found[:, 0]].all()


def test_where_the_person_fills_the_box_the_person_is_taken(
    rng: np.random.Generator, scene: PatchScene
) -> None:
    full = dataclasses.replace(scene, alpha=np.full_like(scene.alpha, 255))
    assert centres(rng, full, 50).shape == (50, 2)


def test_the_last_free_pixel_is_found(rng: np.random.Generator, scene: PatchScene) -> None:
    alpha = np.full_like(scene.alpha, 255)
    alpha[14, 20] = 0
    found = centres(rng, dataclasses.replace(scene, alpha=alpha), 200).tolist()
    assert 15 < found.count([20, 14]) < 70


def test_no_usable_ray_is_refused(rng: np.random.Generator, scene: PatchScene) -> None:
    behind = dataclasses.replace(scene, alpha=np.zeros_like(scene.alpha), box=-BOX[::-1])
    with pytest.raises(UserError, match="no pixel of the crop shows the person or looks at the bo"):
        draw_patches(rng, behind, 1, 8)


def test_a_patch_larger_than_the_crop_is_refused(
    rng: np.random.Generator, scene: PatchScene
) -> None:
    with pytest.raises(UserError, match="a patch of 31x31 pixels does not fit a crop of 40x30"):
        draw_patches(rng, scene, 1, 31)
