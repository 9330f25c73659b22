"""Networks small enough to be written here: ONNX's bytes by hand, TorchScript by torch."""

import pickle
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from actorsnerf_preprocess.aist import open_aist
from actorsnerf_preprocess.segmenter import Segmenter, tried_segmenter
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError
from actorsnerf_preprocess.sources import find_sources, open_source

WriteTree = Callable[..., Any]
PICTURE = np.random.default_rng(5).integers(0, 256, (45, 70, 3), dtype=np.uint8)


def field(number: int, content: bytes | int) -> bytes:
    """One field of a protocol buffer."""
    if isinstance(content, int):
        return bytes([number << 3, content])
    return bytes([number << 3 | 2, len(content)]) + content


def value(name: str, channels: int) -> bytes:
    sizes = [field(1, field(1, 1)), field(1, field(1, channels))]
    sizes += [field(1, field(2, axis)) for axis in (b"height", b"width")]
    shape = field(2, b"".join(sizes))
    return field(1, name.encode()) + field(2, field(1, field(1, 1) + shape))


def onnx(weights: tuple[float, float, float], bias: float = 0.0) -> bytes:
    """A network of one 1x1 convolution of the three colours."""
    kernel = b"".join(field(1, size) for size in (1, 3, 1, 1)) + field(2, 1) + field(8, b"kernel")
    kernel += field(9, struct.pack("<3f", *weights))
    offset = field(1, 1) + field(2, 1) + field(8, b"bias") + field(9, struct.pack("<f", bias))
    node = b"".join(field(1, name) for name in (b"picture", b"kernel", b"bias"))
    node += field(2, b"share") + field(4, b"Conv")
    graph = field(1, node) + field(2, b"net") + field(5, kernel) + field(5, offset)
    graph += field(11, value("picture", 3)) + field(12, value("share", 1))
    size = struct.pack("B", len(graph) & 127 | 128) + struct.pack("B", len(graph) >> 7)
    return field(1, 8) + bytes([7 << 3 | 2]) + size + graph + field(8, field(2, 13))


class Colour(torch.nn.Module):
    """The red channel, times a gain."""

    def __init__(self, gain: float, channels: int = 1) -> None:
        super().__init__()
        self.gain = gain
        self.channels = channels

    def forward(self, picture: torch.Tensor) -> torch.Tensor:
        return picture[:, : self.channels] * self.gain


def script(path: Path, module: torch.nn.Module) -> Path:
    traced = torch.jit.trace(module, torch.rand(1, 3, 32, 32))  # type: ignore[no-untyped-call]
    traced.save(str(path))
    return path


pytestmark = [
    # TorchScript still is what users export; torch announces its successor.
    pytest.mark.filterwarnings("ignore:.*torch.jit.*is deprecated:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:.*torch.jit.*:FutureWarning"),
]


def test_an_onnx_network_sees_red_green_blue_in_that_order(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    for channel in range(3):
        path.write_bytes(onnx(tuple(float(i == channel) for i in range(3))))  # type: ignore[arg-type]
        assert (tried_segmenter(path).mask(PICTURE) == PICTURE[..., channel]).all()


def test_a_torchscript_network(tmp_path: Path) -> None:
    segmenter = tried_segmenter(script(tmp_path / "net.pt", Colour(1.0)))
    assert (segmenter.mask(PICTURE) == PICTURE[..., 0]).all()


def test_it_travels_as_its_path_and_is_known_by_its_content(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(onnx((1.0, 0.0, 0.0)))
    segmenter = tried_segmenter(path)
    again = pickle.loads(pickle.dumps(segmenter))
    assert (again.mask(PICTURE) == segmenter.mask(PICTURE)).all()
    path.write_bytes(onnx((0.0, 1.0, 0.0)))
    assert Segmenter(path).name != segmenter.name
    assert segmenter.name.startswith("made by the user's network net.onnx, SHA-256 ")


def test_what_is_no_share_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(onnx((1.0, 0.0, 0.0), bias=0.5))
    with pytest.raises(SourceError, match=r"answers 0\.5 to 1\.5, expected shares from 0 to 1"):
        Segmenter(path).mask(np.full((32, 32, 3), [[0], [255]] * 16, np.uint8))
    path.write_bytes(onnx((float("nan"), 0.0, 0.0)))
    with pytest.raises(SourceError, match="expected shares from 0 to 1"):
        tried_segmenter(path)
    with pytest.raises(SourceError, match="answers 1 x 2 x 64 x 96, expected 1 x 1 x 64 x 96"):
        tried_segmenter(script(tmp_path / "two.pt", Colour(1.0, 2)))


def test_files_that_are_no_network(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no such file; --segmenter names"):
        Segmenter(tmp_path / "gone.onnx")
    (tmp_path / "net.h5").write_bytes(b"x")
    with pytest.raises(SourceError, match=r"is called neither \.onnx nor \.pt"):
        Segmenter(tmp_path / "net.h5")
    (tmp_path / "net.onnx").write_bytes(b"no network")
    with pytest.raises(SourceError, match="is no ONNX network that OpenCV reads"):
        tried_segmenter(tmp_path / "net.onnx")
    (tmp_path / "net.pt").write_bytes(b"no network")
    with pytest.raises(SourceError, match="is no TorchScript network"):
        tried_segmenter(tmp_path / "net.pt")


def test_data_with_masks_of_its_own_needs_none(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(1), cameras=1)
    (found,) = find_sources(tmp_path)
    with pytest.raises(SourceError, match="has masks of its own, and --segmenter is for AIST"):
        open_source(found, OpenOptions(segmenter=tmp_path / "net.onnx"))


def test_a_video_gets_its_masks_from_the_network(aist: Any, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(onnx((1.0, 0.0, 0.0)))
    found = Found(aist.name, aist.root, "AIST++", "aist++")
    options = OpenOptions(body_model=aist.body, pairs="all", segmenter=path)
    source = open_aist(found, options)
    assert source.mask_source == Segmenter(path).name
    reader = pickle.loads(pickle.dumps(source.reader))
    assert not reader.needs_stage(0)
    for picture in reader.read_many(0, range(2)):
        assert (picture.mask == picture.image[..., 0]).all()
    given = open_aist(found, replace(options, masks=aist.masks))
    assert given.mask_source == "given by the user"
