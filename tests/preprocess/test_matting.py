import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import Float64, UInt8
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.matting import matte

SIZE = 120


def disc(radius: float) -> Float64:
    """The exact share of each pixel that a disc covers, by 8 x 8 points."""
    offsets = (np.arange(8) + 0.5) / 8 - 0.5
    axis = (np.arange(SIZE)[:, None] + offsets).ravel() - 59.3
    fine = np.hypot(axis[:, None], axis) < radius
    shares: Float64 = fine.reshape(SIZE, 8, SIZE, 8).mean((1, 3))
    return shares


def known(stage: UInt8, known: bool = True) -> Background:
    noise = np.full(stage.shape[:2], 2.0, np.float32)
    return Background(stage, noise, np.full(stage.shape[:2], known))


def composite(alpha: Float64, stage: UInt8) -> UInt8:
    person = np.array([200.0, 40.0, 60.0])
    mixed = alpha[..., None] * person + (1 - alpha[..., None]) * stage
    return np.asarray(np.rint(mixed), np.uint8)


@pytest.mark.parametrize("grown", [-1, 0, 1])
def test_the_edge_lands_where_the_picture_has_it(grown: int, rng: np.random.Generator) -> None:
    alpha = disc(40.4)
    noise = rng.integers(60, 160, (SIZE, SIZE, 3)).astype(np.uint8)
    stage = np.asarray(cv2.GaussianBlur(noise, (0, 0), 3), np.uint8)
    cut = (disc(40.4 + grown) > 0.5).astype(np.uint8)
    found = matte(composite(alpha, stage), known(stage), cut, 400.0) / 255
    # A hard cut that is wrong by a pixel errs by 0.017 here; what is left is the blur of solving.
    assert np.abs(found - alpha).mean() < 0.005
    assert found.sum() == pytest.approx(alpha.sum(), rel=0.02)
    assert np.abs((found > 0.5).sum() - (alpha > 0.5).sum()) < 30


def test_inside_is_one_and_far_outside_zero() -> None:
    alpha, stage = disc(30), np.full((SIZE, SIZE, 3), 90, np.uint8)
    found = matte(composite(alpha, stage), known(stage), (alpha > 0.5).astype(np.uint8), 400.0)
    assert (found[disc(26) == 1] == 255).all()
    assert (found[disc(33) == 0] == 0).all()


def test_without_contrast_the_cut_is_only_softened() -> None:
    flat = np.full((SIZE, SIZE, 3), 90, np.uint8)
    cut = (disc(30) > 0.5).astype(np.uint8)
    found = matte(flat, known(flat), cut, 400.0)
    assert np.array_equal(found > 127, cut > 0)
    assert ((found > 0) & (found < 255)).any()


def test_an_unknown_stage_only_softens_the_cut() -> None:
    alpha, stage = disc(30), np.full((SIZE, SIZE, 3), 90, np.uint8)
    cut = (disc(31) > 0.5).astype(np.uint8)
    found = matte(composite(alpha, stage), known(stage, False), cut, 400.0)
    assert np.array_equal(found > 127, cut > 0)


def test_a_person_too_thin_for_a_core_keeps_the_cut() -> None:
    cut = np.zeros((SIZE, SIZE), np.uint8)
    cut[20:100, 60:62] = 1
    flat = np.full((SIZE, SIZE, 3), 90, np.uint8)
    assert (matte(flat, known(flat), cut, 400.0)[30:90, 60:62] > 100).all()
