import numpy as np
import pytest

from actorsnerf_preprocess.imperfections import ANGLE_NOISE, PLACE_NOISE, noisy, ragged
from actorsnerf_preprocess.motions import Motion


def test_fits_are_off_by_two_degrees_and_a_centimetre(rng: np.random.Generator) -> None:
    still = Motion(np.zeros((2000, 24, 3)), np.zeros((2000, 3)), np.zeros((2000, 3)), 15.0)
    found = noisy(still, rng)
    angles = np.linalg.norm(found.poses[:, 1:], axis=-1)
    assert np.sqrt(np.mean(angles**2)) == pytest.approx(ANGLE_NOISE, rel=0.1)
    assert np.sqrt(np.mean(found.transl**2)) == pytest.approx(PLACE_NOISE, rel=0.2)
    assert not found.poses[:, 0].any()


def test_errors_change_slowly(rng: np.random.Generator) -> None:
    still = Motion(np.zeros((500, 24, 3)), np.zeros((500, 3)), np.zeros((500, 3)), 15.0)
    found = noisy(still, rng).poses[:, 1:]
    assert np.abs(np.diff(found, axis=0)).mean() < 0.25 * np.abs(found).mean()


def test_a_ragged_mask_differs_at_its_outline_only(rng: np.random.Generator) -> None:
    labels = np.zeros((256, 256), np.uint8)
    labels[60:200, 80:130], labels[60:200, 130:170] = 5, 9
    torn = ragged(labels, rng)
    changed = (torn > 0) != (labels > 0)
    assert 50 < changed.sum() < 0.15 * (labels > 0).sum()
    kept = (torn > 0) & (labels > 0)
    np.testing.assert_array_equal(torn[kept], labels[kept])
    assert set(np.unique(torn)) == {0, 5, 9}
    assert (torn[70:190, 90:160] > 0).all() and not torn[:45].any()
    # Both bites and bumps.
    assert ((torn > 0) & (labels == 0)).any() and ((torn == 0) & (labels > 0)).any()
