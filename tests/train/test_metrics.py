import math
from typing import TypeAlias

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import Tensor
from torchmetrics.functional.image import peak_signal_noise_ratio as torchmetrics_psnr
from torchmetrics.functional.image import structural_similarity_index_measure

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.metrics import PSNR_CAP, Scores, compare, mean_scores, psnr, ssim

Pair: TypeAlias = tuple[Tensor, Tensor]


def skimage_psnr(truth: Tensor, made: Tensor) -> float:
    found = peak_signal_noise_ratio(  # type: ignore[no-untyped-call]  # has no annotations
        truth.numpy(), made.numpy(), data_range=1.0
    )
    return float(found)


def skimage_ssim(truth: Tensor, made: Tensor, data_range: float) -> float:
    found = structural_similarity(  # type: ignore[no-untyped-call]  # has no annotations
        truth.numpy(), made.numpy(), channel_axis=2, data_range=data_range
    )
    return float(found)


@pytest.fixture
def pair(rng: np.random.Generator) -> Pair:
    truth = rng.random((40, 33, 3))
    noise = rng.normal(scale=0.1, size=truth.shape)
    return torch.from_numpy(truth), torch.from_numpy(truth + noise)


@pytest.fixture
def box() -> Tensor:
    mask = torch.zeros(40, 33, dtype=torch.bool)
    mask[10:30, 5:25] = True
    mask[10, 5] = False  # the region stays a rectangle, the pixels need not
    return mask


def test_psnr_by_hand() -> None:
    truth = torch.zeros(2, 2, 3)
    made = truth.clone()
    made[0, 0] = 0.5  # mean squared error 3 * 0.25 / 12
    assert psnr(truth, made) == pytest.approx(-10 * math.log10(0.0625))


def test_psnr_equals_two_oracles(pair: Pair) -> None:
    truth, made = pair
    ours = psnr(truth, made)
    assert ours == pytest.approx(skimage_psnr(truth, made), abs=1e-9)
    assert ours == pytest.approx(float(torchmetrics_psnr(made, truth, data_range=1.0)), abs=1e-6)


def test_psnr_of_equal_pictures_is_the_cap() -> None:
    assert psnr(torch.ones(3, 3, 3), torch.ones(3, 3, 3)) == PSNR_CAP


@pytest.mark.parametrize("data_range", [1.0, 2.0])
def test_ssim_equals_skimage(pair: Pair, data_range: float) -> None:
    truth, made = pair
    theirs = skimage_ssim(truth, made, data_range)
    assert ssim(truth, made, data_range) == pytest.approx(theirs, abs=1e-10)


def test_ssim_equals_torchmetrics_but_for_the_sample_covariance(pair: Pair) -> None:
    x, y = (picture.movedim(2, 0)[None] for picture in pair)
    # Without the factor 49 / 48 the variances are 48 / 49 as large: so is C2 in the end.
    _, theirs = structural_similarity_index_measure(
        y,
        x,
        gaussian_kernel=False,
        kernel_size=7,
        data_range=1.0,
        k2=0.03 * (48 / 49) ** 0.5,
        return_full_image=True,
    )
    assert ssim(*pair, 1.0) == pytest.approx(float(theirs[..., 3:-3, 3:-3].mean()), abs=1e-9)


def test_ssim_equals_a_loop_over_windows(pair: Pair) -> None:
    truth, made = pair[0][:8, :9], pair[1][:8, :9]
    values = []
    for channel in range(3):
        for y in range(2):
            for x in range(3):
                a = truth[y : y + 7, x : x + 7, channel].numpy().ravel()
                b = made[y : y + 7, x : x + 7, channel].numpy().ravel()
                (va, vab), (_, vb) = np.cov(a, b)
                ma, mb = a.mean(), b.mean()
                top = (2 * ma * mb + 1e-4) * (2 * vab + 9e-4)
                values.append(top / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4)))
    assert ssim(truth, made, 1.0) == pytest.approx(np.mean(values), abs=1e-12)


def test_ssim_of_equal_and_of_constant_pictures() -> None:
    picture = torch.full((9, 9, 3), 0.25)
    assert ssim(picture, picture, 1.0) == pytest.approx(1.0, abs=1e-12)
    # without variance only luminance counts: (2 a b + C1) / (a^2 + b^2 + C1)
    other = torch.full((9, 9, 3), 0.75)
    assert ssim(picture, other, 1.0) == pytest.approx((0.375 + 1e-4) / (0.625 + 1e-4), rel=1e-9)


def test_ssim_refuses_less_than_a_window() -> None:
    with pytest.raises(UserError, match="needs at least 7x7 pixels, the compared region has 5x20"):
        ssim(torch.zeros(20, 5, 3), torch.zeros(20, 5, 3), 1.0)


def test_conventions_differ_as_documented(pair: Pair, box: Tensor) -> None:
    truth, made = pair
    scores = compare(truth, made, box, ("paper", "strict", "box"), None)
    assert scores["paper"].ssim == pytest.approx(skimage_ssim(truth, made, 2.0))
    assert scores["strict"].ssim == pytest.approx(skimage_ssim(truth, made, 1.0))
    crop = (slice(10, 30), slice(5, 25))
    assert scores["box"].ssim == pytest.approx(skimage_ssim(truth[crop], made[crop], 1.0))
    assert scores["paper"].psnr == scores["strict"].psnr == pytest.approx(psnr(truth, made))
    assert scores["box"].psnr == pytest.approx(psnr(truth[box], made[box]))
    assert scores["paper"].ssim > scores["strict"].ssim
    assert scores["paper"].lpips_x1000 is None


def test_empty_background_raises_the_whole_but_not_the_box(pair: Pair, box: Tensor) -> None:
    truth, made = pair
    truth, made = truth * box[..., None], made * box[..., None]
    scores = compare(truth, made, box, ("strict", "box"), None)
    share = float(box.double().mean())
    assert scores["strict"].psnr - scores["box"].psnr == pytest.approx(-10 * math.log10(share))


def test_lpips_is_computed_once_a_region_and_given_times_1000(pair: Pair, box: Tensor) -> None:
    seen = []

    def distance(truth: Tensor, made: Tensor) -> Tensor:
        seen.append(tuple(truth.shape))
        return (truth - made).abs().mean()

    scores = compare(pair[0], pair[1], box, ("paper", "strict", "box"), distance)
    assert seen == [(40, 33, 3), (20, 20, 3)]
    expected = 1000 * float((pair[0] - pair[1]).abs().mean())
    assert scores["paper"].lpips_x1000 == scores["strict"].lpips_x1000 == pytest.approx(expected)


def test_a_box_outside_the_picture_is_refused(pair: Pair) -> None:
    nothing = torch.zeros(40, 33, dtype=torch.bool)
    with pytest.raises(UserError, match="body's box lies outside the picture"):
        compare(pair[0], pair[1], nothing, ("box",), None)


def test_mean_of_lpips_needs_every_picture() -> None:
    assert mean_scores([Scores(1.0, 0.5, 10.0), Scores(3.0, 0.5, 30.0)]) == Scores(2.0, 0.5, 20.0)
    assert mean_scores([Scores(1.0, 0.5, 10.0), Scores(3.0, 0.5, None)]).lpips_x1000 is None
