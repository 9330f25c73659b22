import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.mask_evidence import EvidenceOptions, person_evidence

SIZE = 160
OPTIONS = EvidenceOptions()


@pytest.fixture
def stage(rng: np.random.Generator) -> Background:
    texture = rng.integers(80, 220, (SIZE // 8, SIZE // 8, 3)).astype(np.uint8)
    picture = cv2.resize(texture, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
    noise = np.full((SIZE, SIZE), 2.0, np.float32)
    return Background(np.asarray(picture, np.uint8), noise, np.ones((SIZE, SIZE), bool))


def body() -> UInt8:
    mask = np.zeros((SIZE, SIZE), np.uint8)
    mask[30:130, 60:90] = 255
    return mask


def test_the_empty_stage_is_not_the_person(stage: Background) -> None:
    found = person_evidence(stage.picture, stage, body(), 100.0, OPTIONS)
    assert (found.person < 0).all()
    assert not found.shadow_like.any()


def test_another_colour_is_the_person_also_beside_the_fitted_body(stage: Background) -> None:
    picture = stage.picture.copy()
    picture[40:120, 60:100] = (20, 20, 160)
    found = person_evidence(picture, stage, body(), 100.0, OPTIONS)
    assert (found.person[42:118, 62:98] > 0).all()
    assert (found.person[:, :50] < 0).all()


def test_a_soft_shadow_beside_the_body_is_not_the_person(stage: Background) -> None:
    dark = np.zeros((SIZE, SIZE), np.float32)
    dark[100:140, 100:140] = 1.0
    dimming = 1.0 - 0.4 * cv2.GaussianBlur(dark, (0, 0), 8)
    picture = (stage.picture * dimming[..., None]).astype(np.uint8)
    found = person_evidence(picture, stage, body(), 100.0, OPTIONS)
    assert (found.person[95:150, 95:150] < 0).mean() > 0.98
    assert found.shadow_like[115:125, 115:125].all()
    # The same darkness inside the fitted body is taken for clothes.
    inside = np.full_like(stage.picture, 0)
    inside[:] = (stage.picture * 0.6).astype(np.uint8)
    clothes = person_evidence(inside, stage, body(), 100.0, OPTIONS)
    assert (clothes.person[40:120, 65:85] > 0).all()


def test_darker_than_any_shadow_is_the_person(stage: Background) -> None:
    picture = stage.picture.copy()
    picture[100:140, 91:110] //= 4
    found = person_evidence(picture, stage, body(), 100.0, OPTIONS)
    assert (found.person[102:138, 93:108] > 0).all()


def test_out_of_reach_is_never_the_person(stage: Background) -> None:
    found = person_evidence(255 - stage.picture, stage, body(), 100.0, OPTIONS)
    assert (found.person[:, :35] < 0).all()
    assert found.person[80, 58] > 0


def test_where_the_stage_is_unknown_the_body_decides_but_at_its_outline(
    stage: Background,
) -> None:
    unknown = Background(stage.picture, stage.noise, np.zeros((SIZE, SIZE), bool))
    found = person_evidence(255 - stage.picture, unknown, body(), 100.0, OPTIONS)
    assert np.array_equal(found.person > 0, body() > 0)
    assert found.person[80, 75] == 9 and found.person[80, 50] == -9
    assert 0 < found.person[80, 61] <= 1 and -1 <= found.person[80, 57] < 0


def test_the_distance_is_signed_and_in_body_lengths(stage: Background) -> None:
    found = person_evidence(stage.picture, stage, body(), 100.0, OPTIONS)
    assert found.signed_distance[80, 75] == pytest.approx(0.15, abs=0.012)
    assert found.signed_distance[80, 40] == pytest.approx(-0.20, abs=0.012)
