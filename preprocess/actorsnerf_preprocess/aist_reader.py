"""Pictures and masks of an AIST++ sequence, straight from its videos."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.types import BodyFits, Float64, Int64, UInt8
from actorsnerf_preprocess.aist_video import ANNOTATION_RATE, picture_per_frame, spread_pictures
from actorsnerf_preprocess.aist_views import AistView
from actorsnerf_preprocess.backgrounds import (
    SAMPLE_COUNT,
    Background,
    StageSample,
    estimate_background,
    load_background,
    save_background,
)
from actorsnerf_preprocess.given_masks import GivenMasks
from actorsnerf_preprocess.masks import make_mask
from actorsnerf_preprocess.presence import shows_somebody
from actorsnerf_preprocess.segmenter import Segmenter
from actorsnerf_preprocess.silhouettes import body_silhouette, person_box
from actorsnerf_preprocess.source import Absent, MaskProbe, RawPicture, SourceError

_NEAR_SHARE = 0.15
_COVER_SHARE = 0.05
"""Of the body's length in the picture: how far around it a sample does not vote, if there are
enough others, and never."""


@dataclass(frozen=True)
class AistScene:
    """What the masks are made from: the fitted body in each frame."""

    frames: Int64
    """(F,) at 60 per second."""
    fits: BodyFits
    faces: Int64

    def silhouette(self, view: AistView, frame_index: int) -> UInt8:
        """(H, W) 255 where the body covers the view's picture."""
        return body_silhouette(self._world_vertices(frame_index), self.faces, view.camera)

    def _world_vertices(self, frame_index: int) -> Float64:
        transform = self.fits.world_from_body[frame_index]
        vertices = self.fits.posed_vertices[frame_index].astype(np.float64)
        moved: Float64 = vertices @ transform[:3, :3].T + transform[:3, 3]
        return moved


class AistReader:
    """Reads pictures of the views: a `StageReader`, whose made masks share one stage per view."""

    frames_per_task = 128

    def __init__(
        self,
        views: tuple[AistView, ...],
        scene: AistScene,
        given: tuple[GivenMasks | None, ...],
        segmenter: Segmenter | None = None,
    ) -> None:
        """A reader of the views.

        Args:
            views: with their videos.
            scene: the fitted body.
            given: the masks given for each view; None: they are made.
            segmenter: makes them; None: the difference to the empty stage does.
        """
        self._segmenter = segmenter
        self._views = views
        self._scene = scene
        self._given = given
        self._backgrounds: dict[int, Background] = {}

    def __getstate__(self) -> dict[str, object]:
        """What travels to another process: everything but the backgrounds."""
        return {**self.__dict__, "_backgrounds": {}}

    def files(self, camera_index: int, frame_index: int) -> tuple[Path, ...]:
        """The view's video, and the given mask if there is one."""
        given = self._given[camera_index]
        mask = given.files(int(self._scene.frames[frame_index])) if given is not None else ()
        return (self._views[camera_index].video.path, *mask)

    def probe(self, camera_index: int, frame_index: int) -> MaskProbe | Absent:
        """The given mask; none where masks are made."""
        given = self._given[camera_index]
        if given is None or given.video is not None:
            return MaskProbe(None, "")
        mask = next(given.read_each([int(self._scene.frames[frame_index])]))
        return mask if isinstance(mask, Absent) else MaskProbe(mask, "")

    def read_many(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        """One item per frame index (ascending), in order; one pass over the video."""
        path = self._views[camera_index].video.path
        numbers = [int(self._scene.frames[index]) for index in frame_indices]
        given = self._given[camera_index]
        masks = repeat(None) if given is None else given.read_each(numbers)
        done = 0
        try:
            for picture, mask in zip(picture_per_frame(path, numbers), masks, strict=False):
                if picture is None:
                    yield Absent(str(path), f"no picture of frame {numbers[done]}")
                else:
                    yield self._picture(camera_index, frame_indices[done], picture, mask)
                done += 1
        except SourceError as error:
            for _ in frame_indices[done:]:
                yield Absent(str(path), str(error))

    def background(self, camera_index: int) -> Background:
        """The empty stage of a view, from pictures spread over the sequence."""
        if camera_index not in self._backgrounds:
            self._backgrounds[camera_index] = self._estimated(camera_index)
        return self._backgrounds[camera_index]

    def needs_stage(self, camera_index: int) -> bool:
        """Whether masks of this view are made from the empty stage."""
        return self._given[camera_index] is None and self._segmenter is None

    def save_stage(self, camera_index: int, path: Path) -> None:
        """Estimates a view's background and leaves it at `path`; nothing if no picture decodes.

        That is said of each picture when it is read.

        Raises:
            SourceError: the disk refuses.
        """
        try:
            background = self.background(camera_index)
        except SourceError:
            return
        try:
            save_background(path, background)
        except OSError as error:
            raise SourceError(
                f"{path}: could not be written ({error}): is the disk full?"
            ) from error

    def load_stage(self, camera_index: int, path: Path) -> None:
        """Takes what `save_stage` left in place of estimating it."""
        if camera_index not in self._backgrounds:
            self._backgrounds[camera_index] = load_background(path)

    def _picture(
        self, camera_index: int, frame_index: int, picture: UInt8, mask: UInt8 | Absent | None
    ) -> RawPicture | Absent:
        if isinstance(mask, Absent):
            return mask
        if self._given[camera_index] is not None:
            return RawPicture(picture, mask)
        if self._segmenter is not None:
            mask = self._segmenter.mask(picture)
        else:
            body = self._scene.silhouette(self._views[camera_index], frame_index)
            stage = self.background(camera_index)
            if not shows_somebody(picture, stage, body):
                return Absent(
                    str(self._views[camera_index].video.path), "empty stage where the body projects"
                )
            mask = make_mask(picture, stage, body)
        return RawPicture(picture, mask)

    def _estimated(self, camera_index: int) -> Background:
        view, frames = self._views[camera_index], self._scene.frames
        last = min(float(frames[-1]), view.video.annotated_frames - 1.0)
        times = np.linspace(float(frames[0]), max(last, float(frames[0])), SAMPLE_COUNT)
        samples = []
        for stamp, picture in spread_pictures(view.video.path, (times / ANNOTATION_RATE).tolist()):
            nearest = int(np.abs(frames - stamp * ANNOTATION_RATE).argmin())
            samples.append(_sample(picture, self._scene.silhouette(view, nearest)))
        if not samples:
            raise SourceError(f"{view.video.path}: no picture for a background can be decoded.")
        return estimate_background(samples)


def _sample(picture: UInt8, body: UInt8) -> StageSample:
    """A picture and where the person may be in it: the body with a narrow and with a wide rim."""
    box = person_box(body, 0)
    if box is None:
        nobody = np.zeros(body.shape, np.bool_)
        return StageSample(picture, nobody, nobody)
    length = max(box[3] - box[1], box[2] - box[0])
    distance = np.asarray(cv2.distanceTransform(255 - body, cv2.DIST_L2, 3))
    near, covered = (distance <= share * length + 1 for share in (_NEAR_SHARE, _COVER_SHARE))
    return StageSample(picture, near, covered)
