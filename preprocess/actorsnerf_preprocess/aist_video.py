"""Pictures of a video by their time stamps, decoded forwards only."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.source import SourceError

ANNOTATION_RATE = 60.0
"""Annotation k belongs to the instant k / 60 s, whatever the video's own rate is."""

_HALF_TICK = 0.5
_FETCH_TICKS = 30.0
"""Pictures this close before a wanted frame are converted; a longer gap in a video is a fault."""
_APPROACH_SECONDS = 1.0
"""How far before the first wanted frame a seek lands; the walk from there goes by time stamps."""


@dataclass(frozen=True)
class VideoFacts:
    """What a video's container says about it."""

    path: Path
    size: tuple[int, int]
    """Width, height."""
    rate: float
    """Pictures per second."""
    picture_count: int

    @property
    def annotated_frames(self) -> int:
        """How many instants k / 60 s the video covers."""
        return round(self.picture_count * ANNOTATION_RATE / self.rate)


def probe_video(path: Path) -> VideoFacts:
    """Size, rate and length of a video.

    Raises:
        SourceError: the file is missing, cut off, or in a codec that OpenCV cannot decode.
    """
    capture = _open(path)
    try:
        facts = VideoFacts(
            path,
            (
                int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
                int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
            ),
            float(capture.get(cv2.CAP_PROP_FPS)),
            int(capture.get(cv2.CAP_PROP_FRAME_COUNT)),
        )
        readable = capture.grab()
    finally:
        capture.release()
    if not readable or facts.picture_count < 1 or facts.rate <= 0 or min(facts.size) < 1:
        raise SourceError(
            f"{path}: no picture can be decoded (size {facts.size}, {facts.picture_count} pictures"
            f" at {facts.rate:g} per second); the file is probably cut off: download it again."
        )
    return facts


def pictures_at(path: Path, frames: Sequence[int]) -> Iterator[tuple[int, UInt8]]:
    """(frame, RGB picture) of each frame number, in order; frames past the end are left out.

    Frame k is the picture shown at k / 60 s: the last one whose time stamp is at most half a tick
    (1/120 s) later than that. The half tick absorbs rounded time stamps and puts each picture of
    a 59.94 Hz video on its nearest annotation. The released preparation counts pictures instead
    and drifts by one annotation in a thousand.

    Args:
        path: the video; time zero is its first picture.
        frames: strictly ascending, at 60 per second. One seek leads to about a second before the
            first; it need not be exact, as the walk from there goes by time stamps.

    Raises:
        SourceError: the video cannot be opened.
        ValueError: the frames do not ascend.
    """
    if any(later <= earlier for earlier, later in pairwise(frames)):
        raise ValueError("the frames of one pass over a video have to ascend")
    if not frames:
        return
    capture = _open(path)
    try:
        if not _approach(capture, frames[0]):
            capture.release()
            capture = _open(path)
            if not capture.grab():
                return
        yield from _matched(capture, frames)
    finally:
        capture.release()


def picture_per_frame(path: Path, frames: Sequence[int]) -> Iterator[UInt8 | None]:
    """What `pictures_at` gives, with one item per frame; None where the video has no picture."""
    pictures = pictures_at(path, frames)
    frame, picture = next(pictures, (None, None))
    for wanted in frames:
        if frame == wanted:
            yield picture
            frame, picture = next(pictures, (None, None))
        else:
            yield None


def spread_pictures(path: Path, seconds: Iterable[float]) -> Iterator[tuple[float, UInt8]]:
    """(time stamp, RGB picture) near each wanted time, found by seeking; unreadable ones left out.

    For a background only: the picture may be a neighbour, but its time stamp is its own.

    Raises:
        SourceError: the video cannot be opened.
    """
    capture = _open(path)
    try:
        for wanted in seconds:
            capture.set(cv2.CAP_PROP_POS_MSEC, 1000.0 * wanted)
            if not capture.grab():
                continue
            stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
            picture = _retrieve(capture)
            if picture is not None:
                yield stamp, picture
    finally:
        capture.release()


def _open(path: Path) -> cv2.VideoCapture:
    """An opened video that decodes in one thread; the process pool is what runs in parallel."""
    if not path.is_file():
        raise SourceError(f"{path}: there is no such video.")
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise SourceError(
            f"{path}: OpenCV cannot open this video; it is cut off or in a codec that this build"
            " lacks. Download it again, or convert it: ffmpeg -i IN -c:v libx264 -crf 12 OUT.mp4"
        )
    return capture


def _approach(capture: cv2.VideoCapture, frame: int) -> bool:
    """Whether the video stands at a grabbed picture not later than the frame, after a seek."""
    seconds = frame / ANNOTATION_RATE - _APPROACH_SECONDS
    if seconds <= _APPROACH_SECONDS:
        return capture.grab()
    capture.set(cv2.CAP_PROP_POS_MSEC, 1000.0 * seconds)
    return capture.grab() and _tick(capture) <= frame - _HALF_TICK


def _matched(capture: cv2.VideoCapture, frames: Sequence[int]) -> Iterator[tuple[int, UInt8]]:
    """The walk from a grabbed picture on: a frame is given once a later picture has been seen."""
    position = 0
    shown: UInt8 | None = None
    grabbed = True
    tick = _tick(capture)
    while grabbed and position < len(frames):
        tick = _tick(capture)
        while position < len(frames) and tick > frames[position] + _HALF_TICK:
            if shown is not None:
                yield frames[position], shown
            position += 1
        if position < len(frames) and frames[position] - tick <= _FETCH_TICKS:
            shown = _retrieve(capture)
        grabbed = capture.grab()
    # The last picture stays for one picture's length.
    end = tick + ANNOTATION_RATE / max(float(capture.get(cv2.CAP_PROP_FPS)), 1.0)
    while shown is not None and position < len(frames) and frames[position] + _HALF_TICK < end:
        yield frames[position], shown
        position += 1


def _tick(capture: cv2.VideoCapture) -> float:
    """Time stamp of the grabbed picture in ticks of 1/60 s."""
    return float(capture.get(cv2.CAP_PROP_POS_MSEC)) * ANNOTATION_RATE / 1000.0


def _retrieve(capture: cv2.VideoCapture) -> UInt8 | None:
    """The grabbed picture as RGB."""
    fetched, picture = capture.retrieve()
    if not fetched or picture is None:
        return None
    return np.ascontiguousarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
