import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.mask_evidence import EvidenceOptions
from actorsnerf_preprocess.masks import MaskOptions, make_mask, mask_scores

H, W = 240, 200


def stage_picture(rng: np.random.Generator) -> UInt8:
    texture = rng.integers(90, 220, (H // 6, W // 6, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(texture, (W, H), interpolation=cv2.INTER_CUBIC), np.uint8)


def background_of(picture: UInt8) -> Background:
    return Background(picture, np.full((H, W), 2.0, np.float32), np.ones((H, W), bool))


def figure(grown: int = 0) -> UInt8:
    """A head, a trunk and two legs."""
    mask = np.zeros((H, W), np.uint8)
    cv2.circle(mask, (100, 45), 16 + grown, 255, -1)
    cv2.rectangle(mask, (80 - grown, 60), (120 + grown, 140), 255, -1)
    cv2.rectangle(mask, (78 - grown, 140), (90 + grown, 215 + grown), 255, -1)
    cv2.rectangle(mask, (110 - grown, 140), (122 + grown, 215 + grown), 255, -1)
    return mask


def photographed(stage: UInt8, person: UInt8, rng: np.random.Generator) -> UInt8:
    picture = stage.copy()
    picture[person > 0] = (30, 60, 130)
    picture[100:140][person[100:140] > 0] = (150, 30, 40)
    noisy = picture + rng.normal(0, 2, picture.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def test_clothes_beyond_a_shifted_body_are_found(rng: np.random.Generator) -> None:
    stage = stage_picture(rng)
    person = figure(grown=4)
    body = np.roll(figure(), (3, 4), axis=(0, 1))
    mask = make_mask(photographed(stage, person, rng), background_of(stage), body)
    overlap, outline = mask_scores(mask, person)
    assert overlap > 0.97 and outline > 0.97
    assert mask_scores(body, person)[0] < 0.8


def test_a_soft_shadow_on_the_floor_is_left_out(rng: np.random.Generator) -> None:
    stage = stage_picture(rng)
    person = figure()
    dark = np.zeros((H, W), np.float32)
    cv2.ellipse(dark, (140, 216), (50, 12), 0, 0, 360, 1.0, -1)
    dimmed = stage * (1 - 0.4 * cv2.GaussianBlur(dark, (0, 0), 5))[..., None]
    picture = photographed(dimmed.astype(np.uint8), person, rng)
    overlap, outline = mask_scores(make_mask(picture, background_of(stage), person), person)
    assert overlap > 0.94 and outline > 0.92
    blind = MaskOptions(EvidenceOptions(darkest_shadow=1.1), shadow_doubt=0.0)
    naive = make_mask(picture, background_of(stage), person, blind)
    assert mask_scores(naive, person)[0] < 0.85


def test_a_second_person_that_does_not_touch_is_left_out(rng: np.random.Generator) -> None:
    stage = stage_picture(rng)
    person = figure()
    crowd = person.copy()
    crowd[100:200, 140:160] = 255
    mask = make_mask(photographed(stage, crowd, rng), background_of(stage), person)
    assert not mask[100:200, 142:158].any()


def test_a_large_picture_is_cut_at_half_size_with_the_edge_at_full_size(
    rng: np.random.Generator,
) -> None:
    scale = 3
    stage = np.asarray(cv2.resize(stage_picture(rng), (W * scale, H * scale)), np.uint8)
    person = np.asarray(cv2.resize(figure(4), (W * scale, H * scale)), np.uint8)
    person = np.where(person > 127, np.uint8(255), np.uint8(0))
    body = cv2.erode(person, np.ones((9, 9), np.uint8))
    noise = np.full(body.shape, 2.0, np.float32)
    background = Background(stage, noise, np.ones(body.shape, bool))
    picture = stage.copy()
    picture[person > 0] = (30, 60, 130)
    overlap, outline = mask_scores(make_mask(picture, background, np.asarray(body)), person, 1)
    assert overlap > 0.98 and outline > 0.97


def test_nobody_in_the_picture_gives_an_empty_mask(rng: np.random.Generator) -> None:
    stage = stage_picture(rng)
    nobody = np.zeros((H, W), np.uint8)
    assert not make_mask(stage, background_of(stage), nobody).any()
    # The body should be there and is not (occluded, or a wrong fit): nothing is invented.
    assert not make_mask(stage, background_of(stage), figure()).any()


def test_the_mask_does_not_depend_on_what_ran_before(rng: np.random.Generator) -> None:
    stage = stage_picture(rng)
    picture = photographed(stage, figure(4), rng)
    picture[60:140, 96:104] = stage[60:140, 96:104] // 10 * 9
    first = make_mask(picture, background_of(stage), figure())
    cv2.setRNGSeed(99)
    assert np.array_equal(make_mask(picture, background_of(stage), figure()), first)


def test_scores_by_hand() -> None:
    truth = np.zeros((40, 40), np.uint8)
    truth[10:30, 10:30] = 255
    moved = np.roll(truth, 4, axis=1)
    overlap, outline = mask_scores(moved, truth)
    assert overlap == pytest.approx(16 * 20 / (24 * 20))
    # Of each outline's 76 pixels: 16 + 2 of each of two rows, and 2 at each end of one column.
    assert outline == pytest.approx((2 * 18 + 4) / 76)
    assert mask_scores(moved, truth, tolerance=4) == (overlap, 1.0)
    empty = np.zeros_like(truth)
    assert mask_scores(empty, truth) == (0.0, 0.0)
    assert mask_scores(empty, empty) == (1.0, 1.0)
