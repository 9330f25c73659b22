import numpy as np
import pytest

from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.presence import shows_somebody

BODY = np.zeros((20, 30), np.uint8)
BODY[5:15, 10:20] = 255
STAGE = Background(
    np.full((20, 30, 3), 90, np.uint8), np.full((20, 30), 2.0, np.float32), np.ones((20, 30), bool)
)


@pytest.mark.parametrize(
    ("rows", "level", "expected"),
    [
        (10, 150, True),
        (10, 97, True),  # 3.5 times the noise
        (10, 95, False),  # 2.5 times
        (3, 150, True),  # 30 % of the body
        (2, 150, False),
        (0, 90, False),
    ],
)
def test_somebody_differs_from_the_stage(rows: int, level: int, expected: bool) -> None:
    picture = STAGE.picture.copy()
    picture[5 : 5 + rows, 10:20] = level
    assert shows_somebody(picture, STAGE, BODY) is expected


def test_what_stands_beside_the_body_does_not_count() -> None:
    picture = STAGE.picture.copy()
    picture[:, :10] = 200
    assert not shows_somebody(picture, STAGE, BODY)


def test_where_the_stage_is_not_known_it_cannot_be_told() -> None:
    known = np.zeros((20, 30), bool)
    known[5:7] = True  # 20 % of the body
    assert shows_somebody(STAGE.picture, Background(STAGE.picture, STAGE.noise, known), BODY)
    assert shows_somebody(STAGE.picture, STAGE, np.zeros_like(BODY))
