import pickle
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch
from torch import Tensor

from actorsnerf_model.weight_file import WeightsError
from actorsnerf_train import lpips
from actorsnerf_train.lpips import Lpips, LpipsFiles, LpipsNumbers, load_lpips

CHANNELS = (64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512)
HEAD_CHANNELS = (64, 128, 256, 512, 512)


@pytest.fixture(scope="module")
def published() -> Lpips:
    loaded = load_lpips()
    if loaded is None:
        pytest.skip(f"the published LPIPS weights are not installed: {lpips.INSTALL}")
    return loaded


@pytest.fixture
def pair() -> tuple[Tensor, Tensor]:
    """A pair of 64 x 96 pictures given by a formula, for which others published the distance."""
    y, x = torch.meshgrid(torch.arange(64), torch.arange(96), indexing="ij")
    ramp = (x + 2 * y) / (95 + 2 * 63)
    first = torch.stack([ramp, (x % 17) / 16, ((3 * x + 5 * y) % 29) / 28])
    second = torch.stack([1 - ramp, ((x + 3 * y) % 19) / 18, ((7 * x + 2 * y) % 31) / 30])
    return first[None], second[None]


def random_numbers() -> LpipsNumbers:
    generator = torch.Generator().manual_seed(7)
    inputs = (3, *CHANNELS[:-1])
    return LpipsNumbers(
        kernels=tuple(
            torch.randn(o, i, 3, 3, generator=generator) * (2 / (9 * i)) ** 0.5
            for i, o in zip(inputs, CHANNELS, strict=True)
        ),
        biases=tuple(torch.randn(o, generator=generator) * 0.1 for o in CHANNELS),
        heads=tuple(torch.rand(1, c, 1, 1, generator=generator) for c in HEAD_CHANNELS),
    )


def test_published_distance_of_the_published_pair(
    published: Lpips, pair: tuple[Tensor, Tensor]
) -> None:
    taps = torch.tensor([[0.17693560, 0.11183757, 0.08329640, 0.12961490, 0.08757216]])
    torch.testing.assert_close(published.per_tap(*pair), taps, atol=1e-6, rtol=0)
    assert published(*pair).item() == pytest.approx(0.58925664, abs=1e-5)
    # the same pair taken as colours in [0, 1]
    first, second = (picture[0].permute(1, 2, 0) for picture in pair)
    assert lpips.between(published, first, second).item() == pytest.approx(0.59841830, abs=1e-5)


def test_autocast_does_not_reach_it(published: Lpips, pair: tuple[Tensor, Tensor]) -> None:
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert published(*pair).item() == pytest.approx(0.58925664, abs=1e-5)


def test_same_picture_has_distance_zero_and_a_finite_gradient() -> None:
    network = Lpips(random_numbers())
    for picture in (torch.zeros(1, 3, 32, 32), torch.full((1, 3, 32, 32), -1.0)):
        picture.requires_grad_()
        distance = network(picture, picture.detach().clone())
        distance.sum().backward()
        assert distance.item() == 0
        assert picture.grad is not None
        assert torch.isfinite(picture.grad).all()


def test_dead_features_have_length_zero_and_no_gradient() -> None:
    numbers = random_numbers()
    dead = LpipsNumbers(
        numbers.kernels, tuple(torch.full_like(b, -1e6) for b in numbers.biases), numbers.heads
    )
    picture = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(1))
    picture.requires_grad_()
    distance = Lpips(dead)(picture, -picture.detach())
    distance.sum().backward()
    assert distance.item() == 0
    assert picture.grad is not None
    assert picture.grad.abs().max().item() == 0


def test_features_have_unit_length_and_no_weight_trains() -> None:
    network = Lpips(random_numbers())
    taps = network.taps(torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(2)))
    assert [tuple(tap.shape) for tap in taps] == [
        (2, c, 32 >> i, 32 >> i) for i, c in enumerate(HEAD_CHANNELS)
    ]
    for tap in taps:
        length = tap.norm(dim=1)
        torch.testing.assert_close(length[length > 0], torch.ones_like(length[length > 0]))
    assert list(network.parameters()) == []


def test_per_tap_is_the_formula_pixel_by_pixel() -> None:
    numbers = random_numbers()
    network = Lpips(numbers)
    generator = torch.Generator().manual_seed(3)
    a, b = (2 * torch.rand(1, 3, 16, 16, generator=generator) - 1 for _ in range(2))
    expected = []
    for head, tap_a, tap_b in zip(numbers.heads, network.taps(a), network.taps(b), strict=True):
        _, channels, height, width = tap_a.shape
        total = 0.0
        for y in range(height):
            for x in range(width):
                difference = tap_a[0, :, y, x] - tap_b[0, :, y, x]
                total += sum(
                    float(head[0, c, 0, 0]) * float(difference[c]) ** 2 for c in range(channels)
                )
        expected.append(total / (height * width))
    torch.testing.assert_close(network.per_tap(a, b)[0], torch.tensor(expected), rtol=1e-4, atol=0)


def user_files(folder: Path, numbers: LpipsNumbers, suffix: str) -> LpipsFiles:
    vgg = {
        f"features.{n}.weight": k for n, k in zip(lpips.CONV_LAYERS, numbers.kernels, strict=True)
    }
    vgg |= {f"features.{n}.bias": b for n, b in zip(lpips.CONV_LAYERS, numbers.biases, strict=True)}
    heads = {f"lin{i}.model.1.weight": h for i, h in enumerate(numbers.heads)}
    files = LpipsFiles(folder / f"vgg{suffix}", folder / f"heads{suffix}")
    assert files.lpips_vgg is not None and files.lpips_heads is not None
    for path, state in ((files.lpips_vgg, vgg), (files.lpips_heads, heads)):
        if suffix == ".pth":
            torch.save(state, path)
        else:
            safetensors.torch.save_file(state, path)
    return files


@pytest.mark.parametrize("suffix", [".pth", ".safetensors"])
def test_a_users_files_give_the_same_network(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = random_numbers()
    monkeypatch.setattr(lpips, "NUMBERS_SHA256", numbers.digest())
    loaded = load_lpips(user_files(tmp_path, numbers, suffix))
    assert loaded is not None
    picture = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(4))
    expected = Lpips(numbers)(picture, -picture)
    torch.testing.assert_close(loaded(picture, -picture), expected, rtol=0, atol=0)


def test_other_numbers_are_refused(tmp_path: Path) -> None:
    files = user_files(tmp_path, random_numbers(), ".pth")
    with pytest.raises(WeightsError, match=r"vgg\.pth: not the published LPIPS numbers"):
        load_lpips(files)


def test_half_of_a_users_weights_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="needs both files"):
        load_lpips(LpipsFiles(lpips_vgg=tmp_path / "vgg.pth"))


def test_missing_and_wrong_user_files_are_named(tmp_path: Path) -> None:
    files = user_files(tmp_path, random_numbers(), ".pth")
    with pytest.raises(WeightsError, match=r"absent\.pth: no such file"):
        load_lpips(LpipsFiles(tmp_path / "absent.pth", files.lpips_heads))
    with pytest.raises(WeightsError, match=r"heads\.pth: has no entry features\.0\.weight"):
        load_lpips(LpipsFiles(files.lpips_heads, files.lpips_heads))


def test_without_weights_there_is_no_lpips(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lpips, "PACKAGE", "no_such_package_is_installed")
    assert load_lpips() is None


def test_a_changed_package_file_is_not_unpickled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "vgg16.ckpt"
    path.write_bytes(pickle.dumps({"VGG16_0": np.zeros(3)}))
    monkeypatch.setattr(lpips, "installed_weights", lambda: path)
    with pytest.raises(WeightsError, match=r"vgg16\.ckpt: SHA-256 is [0-9a-f]{16}…, expected 2ecb"):
        load_lpips()


@pytest.mark.parametrize("name", ["vgg.pth", "vgg.safetensors"])
def test_a_damaged_file_of_weights_is_one_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    for content in (b"junk", b""):
        path.write_bytes(content)
        with pytest.raises(WeightsError, match=rf"{name}: cannot be read as weights") as refusal:
            load_lpips(LpipsFiles(path, path))
        assert "\n" not in str(refusal.value)
