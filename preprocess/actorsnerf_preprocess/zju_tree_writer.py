"""Raw ZJU-MoCap trees written: cameras, fits and pictures of one actor, as a layout says."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from actorsnerf_datasets.body_model import BodyModel, pose
from actorsnerf_datasets.rotations import matrix_from_axis_angle
from actorsnerf_datasets.types import Float32, UInt8
from actorsnerf_preprocess.source import SourceCamera, SourceError
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_layouts import Layout

JPEG_QUALITY = 95


@runtime_checkable
class TreeWriter(Protocol):
    """Writes one actor's folder. Cameras are indices, frames are the numbers of the tree."""

    @property
    def folder(self) -> Path:
        """The actor's folder."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras' names."""

    @property
    def first(self) -> int:
        """Number of the first frame."""

    def picture_name(self, camera: int, number: int) -> str:
        """Path of a picture below the folder."""

    def write_cameras(self, cameras: Sequence[SourceCamera], numbers: Sequence[int]) -> None:
        """Writes the calibration, and which pictures the given frames have."""

    def write_fits(self, fits: Mapping[int, RawFit], model: BodyModel) -> None:
        """Writes the fits of all frames, by their numbers, and what follows from them."""

    def write_picture(self, camera: int, number: int, rgb: UInt8, labels: UInt8) -> None:
        """Writes a picture and its masks; labels (H, W) are 0 outside the person."""


class AnnotatedTreeWriter:
    """Writes a tree with an `annots.npy`."""

    def __init__(self, folder: Path, layout: Layout, cameras: int) -> None:
        """Makes the actor's folder, with one for each camera.

        Args:
            folder: the actor's.
            layout: how its files are called.
            cameras: how many there are, the first of the layout's.
        """
        self.folder = folder
        self.cameras = layout.cameras[:cameras]
        self.first = layout.first
        self._layout = layout
        for camera in range(cameras):
            for name in (self.picture_name(camera, 0), *self._mask_names(camera, 0)):
                (folder / name).parent.mkdir(parents=True, exist_ok=True)

    def picture_name(self, camera: int, number: int) -> str:
        """Path of a picture below the folder."""
        return self._layout.stored_name(self.folder.name, camera, number)

    def write_cameras(self, cameras: Sequence[SourceCamera], numbers: Sequence[int]) -> None:
        """Writes `annots.npy`, translations in millimetres."""
        cams: dict[str, list[object]] = {
            "K": [camera.K for camera in cameras],
            "D": [camera.distortion[:, None] for camera in cameras],
            "R": [camera.R for camera in cameras],
            "T": [camera.T[:, None] * 1000 for camera in cameras],
        }
        if self._layout.plain_lists:
            cams = {key: [np.asarray(value).tolist() for value in cams[key]] for key in cams}
        name = self._layout.listed_name
        pictures = [
            {"ims": [name(self.folder.name, camera, number) for camera in range(len(cameras))]}
            for number in numbers
        ]
        save_array(self.folder / "annots.npy", {"cams": cams, "ims": pictures})

    def write_fits(self, fits: Mapping[int, RawFit], model: BodyModel) -> None:
        """Writes a file of parameters and one of vertices per frame and set of fits."""
        for number, fit in fits.items():
            listed = fit.pose[1:] if self._layout.rootless else fit.pose
            parameters = {
                "poses": listed.reshape(1, -1),
                "Rh": fit.Rh[None],
                "Th": fit.Th[None],
                "shapes": fit.betas[None],
            }
            for folders in self._layout.fits:
                vertices = world_mesh(fit, model, folders.pose_blend)
                save_array(self.folder / folders.parameters / f"{number}.npy", parameters)
                save_array(self.folder / folders.vertices / f"{number}.npy", vertices)

    def write_picture(self, camera: int, number: int, rgb: UInt8, labels: UInt8) -> None:
        """Writes a JPEG and a mask for each of the layout's sets."""
        write_image(self.folder / self.picture_name(camera, number), rgb[..., ::-1])
        for masks, name in zip(self._layout.masks, self._mask_names(camera, number), strict=True):
            write_image(
                self.folder / name, labels if masks.labels else (labels > 0).astype(np.uint8)
            )

    def _mask_names(self, camera: int, number: int) -> tuple[str, ...]:
        return tuple(
            self._layout.mask_name(masks, self.folder.name, camera, number)
            for masks in self._layout.masks
        )


def world_mesh(fit: RawFit, model: BodyModel, pose_blend: bool) -> Float32:
    """The vertices (V, 3) of a fit without root rotation, by EasyMocap's rule v = R(Rh) x + Th."""
    posed = pose(model, fit.betas, fit.pose, pose_blend)
    world: Float32 = (posed.vertices @ matrix_from_axis_angle(fit.Rh).T + fit.Th).astype(np.float32)
    return world


def save_array(path: Path, content: object) -> None:
    """Writes an array, or whatever ZJU-MoCap wraps into one, making the folder if needed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, np.asarray(content))


def write_image(path: Path, image: UInt8) -> None:
    """Writes a picture, blue first as OpenCV has it, making the folder if needed.

    Raises:
        SourceError: the disk refuses.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else []
    if not cv2.imwrite(str(path), np.ascontiguousarray(image), quality):
        raise SourceError(f"{path}: cannot be written; is the disk full?")
