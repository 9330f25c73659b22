"""Raw AIST++ trees written: annotations in scaled centimetres, and videos."""

import json
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.conventions import aist_from_metres
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.source import SourceCamera, SourceError

FRAMES_PER_SECOND = 60.0


@dataclass(frozen=True)
class AistMotion:
    """One dancer's fits as AIST++ has them, before they are scaled."""

    poses: Float64
    """(F, 24, 3) axis-angle; the root is the global orientation."""
    transl: Float64
    """(F, 3) metres of the body."""
    scaling: float
    """Centimetres per metre of the body."""


@dataclass(frozen=True)
class AistTreeWriter:
    """Writes `annotations/` and `videos/` below a folder, making folders as needed."""

    root: Path

    def write_motion(self, sequence: str, motion: AistMotion) -> None:
        """Writes the fits of a sequence."""
        write_motion(self._annotations("motions") / f"{sequence}.pkl", motion)

    def write_cameras(self, setting: str, cameras: Sequence[SourceCamera], scaling: float) -> None:
        """Writes the cameras of a setting.

        Args:
            setting: its name.
            cameras: metres.
            scaling: units of the file per metre.
        """
        entries = [
            {
                "name": camera.name,
                "size": list(camera.size),
                "matrix": camera.K.tolist(),
                "distortions": camera.distortion.tolist(),
                "rotation": cv2.Rodrigues(camera.R)[0].ravel().tolist(),
                "translation": (scaling * camera.T).tolist(),
            }
            for camera in cameras
        ]
        (self._annotations("cameras") / f"{setting}.json").write_text(json.dumps(entries))

    def write_mapping(self, setting: str, sequences: Sequence[str]) -> None:
        """Writes which setting each sequence was recorded in: the same for all."""
        lines = [f"{sequence} {setting}\n" for sequence in sequences]
        (self._annotations("cameras") / "mapping.txt").write_text("".join(lines))

    def write_ignore_list(self, names: Sequence[str]) -> None:
        """Writes it with a blank after the first name and an empty last line, as in the real."""
        first, *others = names
        lines = [f"{first} ", *others]
        (self._annotations(".") / "ignore_list.txt").write_text("\n".join(lines) + "\n\n")

    def write_splits(self, training: Sequence[str], held_out: Sequence[str]) -> None:
        """Writes the lists of the splits, without a final newline, as in the real."""
        folder = self._annotations("splits")
        for split, names in (("train", training), ("val", held_out), ("test", held_out)):
            for kind in ("pose", "crossmodal"):
                (folder / f"{kind}_{split}.txt").write_text("\n".join(names))

    def open_video(self, name: str, size: tuple[int, int]) -> cv2.VideoWriter:
        """A video to write pictures of a size to, blue first; release it when it is complete.

        Raises:
            SourceError: it cannot be written.
        """
        path = self.root / "videos" / f"{name}.mp4"
        path.parent.mkdir(parents=True, exist_ok=True)
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        video = cv2.VideoWriter(str(path), codec, FRAMES_PER_SECOND, size)
        if not video.isOpened():
            raise SourceError(f"{path}: cannot be written as a video; is the disk full?")
        return video

    def _annotations(self, name: str) -> Path:
        folder = self.root / "annotations" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def write_motion(path: Path, motion: AistMotion) -> None:
    """Writes fits into a file of their own; translations are scaled."""
    content = {
        "smpl_poses": motion.poses.reshape(-1, 72),
        "smpl_scaling": np.array([motion.scaling]),
        "smpl_trans": aist_from_metres(motion.transl, motion.scaling),
        "smpl_loss": 0.0,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        pickle.dump(content, file, protocol=4)
