import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.zju_intrinsics import intrinsics_of

NAMES = ("B1", "B2", "B3")


def released() -> Float64:
    """K of three cameras, with principal points as far off as in the data set."""
    return np.array(
        [
            [[1040.0, 0, cx], [0, 1040, cy], [0, 0, 1]]
            for cx, cy in ((481, 462), (520, 500), (564, 511))
        ]
    )


@pytest.mark.parametrize("side", [256, 512, 682, 720, 768, 900, 1280, 1536, 2048])
def test_k_follows_resized_pictures(side: int) -> None:
    found = intrinsics_of(released(), [(side, side)] * 3, NAMES)
    factor = side / 1024
    assert found.K[:, 0, 0] == pytest.approx([1040 * factor] * 3)
    assert found.K[1, :2, 2] == pytest.approx([520.5 * factor - 0.5, 500.5 * factor - 0.5])
    (finding,) = found.findings
    assert finding.sentence.startswith(
        f"Pictures of 3 cameras are {side} x {side}, not 1024 x 1024: K belongs to 1024 x 1024 and "
        "was scaled, as its principal point (median [520.0, 500.0]) is off the middle by 0.0"
    )
    assert finding.severity == "note"
    assert found.notes == (finding.sentence,)


@pytest.mark.parametrize("size", [(512, 512), (720, 720), (1536, 1536), (1280, 720), (1920, 1080)])
def test_k_of_the_pictures_own_size_is_kept(size: tuple[int, int]) -> None:
    own = released() * (np.array([*size, 1024.0]) / 1024)[:, None]
    found = intrinsics_of(own, [size] * 3, NAMES)
    assert np.array_equal(found.K, own)
    (finding,) = found.findings
    assert f"K belongs to {size[0]} x {size[1]} and was kept" in finding.sentence


def test_pictures_of_the_released_size_stay_as_they_are() -> None:
    found = intrinsics_of(released(), [(1024, 1024)] * 3, NAMES)
    assert np.array_equal(found.K, released())
    assert not found.findings and not found.notes


def test_each_size_is_decided_by_its_cameras() -> None:
    found = intrinsics_of(released(), [(720, 720), (1024, 1024), (720, 720)], NAMES)
    assert found.K[:, 0, 0] == pytest.approx([1040 * 720 / 1024, 1040, 1040 * 720 / 1024])
    assert [finding.sentence[:21] for finding in found.findings] == ["Pictures of 2 cameras"]


def test_a_close_choice_is_a_warning() -> None:
    (finding,) = intrinsics_of(released(), [(1000, 1000)] * 3, NAMES).findings
    assert finding.severity == "warning"
    assert finding.sentence.endswith("compare projected bodies with the pictures.")


def test_pictures_of_other_proportions_are_a_warning() -> None:
    (finding,) = intrinsics_of(released(), [(1024, 600)] * 3, NAMES).findings
    assert finding.severity == "warning"
    assert "were the pictures cut?" in finding.sentence
