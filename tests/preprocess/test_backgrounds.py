import numpy as np
import pytest

from actorsnerf_preprocess.backgrounds import MIN_SEEN, StageSample, estimate_background

H, W = 70, 40


def test_the_median_of_what_is_not_covered_is_the_stage(rng: np.random.Generator) -> None:
    stage = rng.integers(0, 250, (H, W, 3)).astype(np.uint8)
    samples = []
    for index in range(9):
        picture, covered = stage.copy(), np.zeros((H, W), bool)
        # The person stands still on half of the samples and hides the same place in each.
        if index < 5:
            covered[20:50, 10:30] = True
            picture[20:50, 10:30] = 255
        samples.append(StageSample(picture, covered, covered))
    background = estimate_background(samples)
    assert np.array_equal(background.picture, stage)
    assert background.known.all()
    assert (background.noise == 2.0).all()


def test_medians_equal_a_slow_twin(rng: np.random.Generator) -> None:
    pictures = rng.integers(0, 256, (7, H, W, 3)).astype(np.uint8)
    covered = rng.random((7, H, W)) < 0.3
    samples = [StageSample(p, c, c) for p, c in zip(pictures, covered, strict=True)]
    background = estimate_background(samples)
    for row, column in rng.integers(0, (H, W), (50, 2)):
        seen = pictures[~covered[:, row, column], row, column]
        if len(seen) < MIN_SEEN:
            assert not background.known[row, column]
            continue
        lower_median = np.sort(seen, axis=0)[(len(seen) - 1) // 2]
        assert np.array_equal(background.picture[row, column], lower_median)


def test_what_nobody_saw_is_marked_and_filled_from_around() -> None:
    picture = np.full((H, W, 3), 90, np.uint8)
    picture[30:40, 10:20] = 250
    covered = np.zeros((H, W), bool)
    covered[30:40, 10:20] = True
    background = estimate_background([StageSample(picture, covered, covered)] * 4)
    assert np.array_equal(background.known, ~covered)
    assert np.abs(background.picture.astype(int) - 90).max() <= 2


def test_the_rim_votes_only_where_nothing_else_does() -> None:
    near, covered = np.zeros((2, H, W), bool)
    near[10:60, 5:35] = True
    covered[20:50, 10:30] = True
    rim = np.full((H, W, 3), 90, np.uint8)
    rim[near] = 120
    always = [StageSample(rim, near, covered)] * 4
    background = estimate_background(always)
    assert np.array_equal(background.known, ~covered)
    assert (background.picture[near & ~covered] == 120).all()
    free = np.zeros((H, W), bool)
    plain = [StageSample(np.full((H, W, 3), 90, np.uint8), free, free)] * 3
    assert (estimate_background([*always, *plain]).picture == 90).all()


def test_noise_is_the_mean_deviation_where_it_is_more_than_the_floor(
    rng: np.random.Generator,
) -> None:
    free = np.zeros((H, W), bool)
    pictures = np.clip(rng.normal(120, 10, (24, H, W, 3)), 0, 255).astype(np.uint8)
    background = estimate_background([StageSample(picture, free, free) for picture in pictures])
    # E|x| of a normal distribution is sigma sqrt(2 / pi).
    assert background.noise.mean() == pytest.approx(10 * np.sqrt(2 / np.pi), rel=0.05)
    assert background.noise.min() >= 2.0
