"""Masks from a user's own network, an ONNX or a TorchScript file.

The network takes 1 x 3 x H x W, RGB in [0, 1], H and W multiples of 32, and gives the person's
share of each pixel, 1 x 1 x H x W (or 1 x H x W) in [0, 1]. Whatever else yours does (another
scale, mean and deviation, logits, classes) goes into the file when you export it.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.source import SourceError

MULTIPLE = 32
"""Pixels; pictures grow at the right and below to the next multiple, repeating their border."""
TORCHSCRIPT = (".pt", ".pth", ".torchscript")
Float32 = NDArray[np.float32]
Network = Callable[[Float32], object]


class Segmenter:
    """A network that finds the person; travels to other processes as its path."""

    def __init__(self, path: Path) -> None:
        """The network of a file, opened when it is first asked.

        Raises:
            SourceError: no such file, or one that is neither ONNX nor TorchScript by its name.
        """
        if not path.is_file():
            raise SourceError(
                f"{path}: no such file; --segmenter names an ONNX or TorchScript file."
            )
        if path.suffix not in (".onnx", *TORCHSCRIPT):
            raise SourceError(
                f"{path}: is called neither .onnx nor {', '.join(TORCHSCRIPT)}: export your "
                "network to one of the two."
            )
        self.path = path
        self.digest = hashlib.sha256(path.read_bytes()).hexdigest()
        self._network: Network | None = None

    def __getstate__(self) -> dict[str, object]:
        """What travels: no open network."""
        return {**self.__dict__, "_network": None}

    @property
    def name(self) -> str:
        """What a prepared file records as the source of its masks."""
        return f"made by the user's network {self.path.name}, SHA-256 {self.digest}"

    def mask(self, picture: UInt8) -> UInt8:
        """The person's share (H, W), 0 to 255, of an RGB picture (H, W, 3).

        Raises:
            SourceError: the file holds no network, or the network answers something else.
        """
        height, width = picture.shape[:2]
        below, right = -height % MULTIPLE, -width % MULTIPLE
        padded = np.pad(picture, ((0, below), (0, right), (0, 0)), mode="edge")
        batch = np.ascontiguousarray(padded.transpose(2, 0, 1)[None]).astype(np.float32)
        batch /= 255
        share = self._answer(batch)[:height, :width]
        levels: UInt8 = np.round(share * 255).astype(np.uint8)
        return levels

    def _answer(self, batch: Float32) -> Float32:
        if self._network is None:
            self._network = _opened(self.path)
        try:
            answer = np.asarray(self._network(batch), dtype=np.float32)
        except (cv2.error, RuntimeError, TypeError, ValueError) as error:
            raise SourceError(
                f"{self.path}: does not take a picture of 1 x 3 x {batch.shape[2]} x "
                f"{batch.shape[3]} ({_line(error)}): export it for any height and width."
            ) from error
        if answer.size != batch[0, 0].size:
            raise SourceError(
                f"{self.path}: answers {' x '.join(map(str, answer.shape))}, expected 1 x 1 x "
                f"{batch.shape[2]} x {batch.shape[3]}, the person's share of each pixel."
            )
        low, high = float(answer.min()), float(answer.max())
        if not (low >= -1e-3 and high <= 1 + 1e-3):  # NaN too
            raise SourceError(
                f"{self.path}: answers {low:g} to {high:g}, expected shares from 0 to 1: put the "
                "sigmoid or softmax into the exported network."
            )
        return answer.reshape(batch.shape[2:]).clip(0, 1)


def tried_segmenter(path: Path) -> Segmenter:
    """The segmenter of a file, after it has answered for a small picture.

    Raises:
        SourceError: it cannot be opened, or answers something else than shares.
    """
    segmenter = Segmenter(path)
    segmenter.mask(np.zeros((2 * MULTIPLE, 3 * MULTIPLE, 3), np.uint8))
    return segmenter


def _opened(path: Path) -> Network:
    return _onnx(path) if path.suffix == ".onnx" else _torchscript(path)


def _onnx(path: Path) -> Network:
    try:
        network = cv2.dnn.readNetFromONNX(str(path))
    except cv2.error as error:
        raise SourceError(
            f"{path}: is no ONNX network that OpenCV reads ({_line(error)})."
        ) from error
    if network.empty():
        raise SourceError(f"{path}: is no ONNX network that OpenCV reads (it has no layers).")

    def answer(batch: Float32) -> object:
        network.setInput(batch)
        return network.forward()

    return answer


def _torchscript(path: Path) -> Network:
    try:
        import torch
    except ImportError as error:
        raise SourceError(
            f"{path}: a TorchScript file needs torch: pip install '.[train]'."
        ) from error
    try:
        network = torch.jit.load(str(path), map_location="cpu").eval()  # type: ignore[no-untyped-call]
    except RuntimeError as error:
        raise SourceError(f"{path}: is no TorchScript network ({_line(error)}).") from error

    def answer(batch: Float32) -> object:
        with torch.no_grad():
            return network(torch.from_numpy(batch)).float().numpy()

    return answer


def _line(error: Exception) -> str:
    """The error's first words."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0][:120] if lines else type(error).__name__


__all__ = ["Segmenter", "tried_segmenter"]
