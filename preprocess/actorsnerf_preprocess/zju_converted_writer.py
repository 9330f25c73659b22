"""Trees written as HumanNeRF's and ActorsNeRF's preparations leave them: PNGs and pickles.

Their pictures are the raw ones, decoded from JPEG and stored without loss: whole and distorted.
Numbers are float32, and betas are only in the rest joints.
"""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.body_model import BodyModel, pose, rest
from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.source import SourceCamera
from actorsnerf_preprocess.zju_fits import RawFit
from actorsnerf_preprocess.zju_tree_writer import (
    JPEG_QUALITY,
    save_array,
    world_mesh,
    write_image,
)


@dataclass(frozen=True)
class ConvertedLayout:
    """What one of the two preparations writes."""

    cameras: tuple[str, ...]
    """Folders below the actor's."""
    folder: str = "{actor}"
    """Of an actor."""
    extras: bool = False
    """Whether `new_vertices/` and `lbs/tvertices.npy` lie beside them."""


HUMANNERF = ConvertedLayout(cameras=(".",))
"""Only the training camera, without a folder of its own."""
ACTORSNERF = ConvertedLayout(cameras=tuple(map(str, range(23))), extras=True)


class ConvertedTreeWriter:
    """Writes one actor's prepared tree."""

    first = 0

    def __init__(self, folder: Path, layout: ConvertedLayout, cameras: int) -> None:
        """Makes the actor's folder, with those of its cameras.

        Args:
            folder: the actor's.
            layout: whose preparation.
            cameras: how many there are; HumanNeRF's has the first alone.
        """
        self.folder = folder
        self.cameras = layout.cameras[:cameras]
        self._extras = layout.extras
        for camera in self.cameras:
            for kind in ("images", "masks"):
                (folder / camera / kind).mkdir(parents=True, exist_ok=True)

    def picture_name(self, camera: int, number: int) -> str:
        """Path of a picture below the folder."""
        return self._name("images", camera, number)

    def write_cameras(self, cameras: Sequence[SourceCamera], numbers: Sequence[int]) -> None:
        """Writes `cameras.pkl` for each camera, metres, once per frame as they have it."""
        for name, camera in zip(self.cameras, cameras, strict=True):
            extrinsics = np.eye(4)
            extrinsics[:3, :3], extrinsics[:3, 3] = camera.R, camera.T
            entry = {
                "intrinsics": camera.K.astype(np.float32),
                "extrinsics": extrinsics,
                "distortions": camera.distortion.astype(np.float32),
            }
            frames = {f"frame_{number:06d}": entry for number in numbers}
            _dump(self.folder / name / "cameras.pkl", frames)

    def write_fits(self, fits: Mapping[int, RawFit], model: BodyModel) -> None:
        """Writes `mesh_infos.pkl` and `canonical_joints.pkl` for each camera."""
        infos = {f"frame_{number:06d}": _info(fit, model) for number, fit in fits.items()}
        mean_betas = np.mean([fit.betas for fit in fits.values()], axis=0)
        joints, vertices = rest(model, mean_betas)
        for name in self.cameras:
            _dump(self.folder / name / "mesh_infos.pkl", infos)
            canonical = {"joints": joints.astype(np.float32)}
            _dump(self.folder / name / "canonical_joints.pkl", canonical)
        if self._extras:
            save_array(self.folder / "lbs" / "tvertices.npy", vertices.astype(np.float32))
            for number, fit in fits.items():
                path = self.folder / "new_vertices" / f"{number}.npy"
                save_array(path, world_mesh(fit, model, pose_blend=True))

    def write_picture(self, camera: int, number: int, rgb: UInt8, labels: UInt8) -> None:
        """Writes a picture and its mask of three channels, both PNG."""
        coded = cv2.imencode(
            ".jpg",
            np.ascontiguousarray(rgb[..., ::-1]),
            [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY],
        )[1]
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
        write_image(self.folder / self.picture_name(camera, number), image)
        mask = np.repeat(np.where(labels > 0, np.uint8(255), np.uint8(0))[..., None], 3, axis=-1)
        write_image(self.folder / self._name("masks", camera, number), mask)

    def _name(self, kind: str, camera: int, number: int) -> str:
        return (Path(self.cameras[camera]) / kind / f"frame_{number:06d}.png").as_posix()


def _info(fit: RawFit, model: BodyModel) -> dict[str, object]:
    """One frame of `mesh_infos.pkl`; joints are in the body frame."""
    posed = pose(model, fit.betas, fit.pose)
    numbers = {
        "Rh": fit.Rh,
        "Th": fit.Th,
        "poses": fit.pose.ravel(),
        "joints": posed.joints,
        "tpose_joints": posed.rest_joints,
    }
    return {key: value.astype(np.float32) for key, value in numbers.items()}


def _dump(path: Path, content: object) -> None:
    path.write_bytes(pickle.dumps(content))
