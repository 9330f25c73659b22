import numpy as np

from actorsnerf_preprocess.backdrops import hall, studio
from actorsnerf_preprocess.renderer import Pinhole


def level_camera() -> Pinhole:
    """Stands 1.5 m above the floor and looks along +z; the horizon is row 30 of 60."""
    K = np.array([[50.0, 0, 40.0], [0, 50.0, 30.0], [0, 0, 1]])
    return Pinhole(
        K, np.diag([1.0, -1.0, -1.0]) @ np.diag([-1.0, 1.0, -1.0]), np.zeros(3), (80, 60)
    )


def raised(camera: Pinhole, height: float) -> Pinhole:
    return Pinhole(camera.K, camera.R, -camera.R @ np.array([0.0, height, 0.0]), camera.size)


def test_the_studio_is_dark_and_repeats_with_its_seed() -> None:
    first, again, other = (
        studio(level_camera(), np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert first.shape == (60, 80, 3) and first.mean() < 45
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_the_hall_has_its_floor_below_the_horizon() -> None:
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    camera = raised(Pinhole(level_camera().K, down, np.zeros(3), (80, 60)), 1.5)
    picture = hall(camera, np.random.default_rng(0)).astype(float)
    above, below = picture[:28].mean(axis=(0, 1)), picture[42:].mean(axis=(0, 1))
    assert above.mean() > below.mean() + 15
    # Wood is redder than the wall.
    assert below[0] / below[2] > above[0] / above[2] + 0.1
    rows = picture.mean(axis=(1, 2))
    # 12 m of floor end 1.5 / 12 * 50 = 6.25 rows below the horizon.
    assert np.abs(np.argmin(np.diff(rows)) - 36) <= 1
