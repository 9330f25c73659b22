"""What worker processes do: probe masks, and turn raw pictures into compressed crops."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from actorsnerf_datasets.types import Picture
from actorsnerf_datasets.writer import StoredPicture, encode_picture
from actorsnerf_preprocess.packed_masks import unpacked_mask
from actorsnerf_preprocess.pictures import Crop, stored_picture, stored_size
from actorsnerf_preprocess.probes import Probe, judged_mask, probe_picture
from actorsnerf_preprocess.source import (
    Absent,
    FrameReader,
    RawPicture,
    SplitReader,
    StageReader,
)
from actorsnerf_preprocess.workers import JobFile, PictureTask, load_job, load_lens


@dataclass(frozen=True)
class EncodeTask:
    """Pictures of one camera and the crop of each."""

    pictures: PictureTask
    crops: tuple[Crop, ...]
    judge: bool = False
    """Masks are seen for the first time now, and have to be judged."""
    masks: tuple[bytes, ...] = ()
    """Of each picture, from its probe; empty: they are read again."""
    with_content: bool = False
    """Outcomes hold the pictures uncompressed too: for a writer near enough to want them."""


@dataclass(frozen=True)
class StageTask:
    """The empty stage of one camera, to be estimated once for all processes."""

    job: JobFile
    camera: int


@dataclass(frozen=True)
class Outcome:
    """What became of one picture in the second pass."""

    camera: int
    frame: int
    stored: StoredPicture | None
    """None: the picture is not stored, for `reason`."""
    reason: str
    where: str
    touching: bool
    """The person reaches the border of the crop, inside the picture."""
    inside: float = np.nan
    """Share of the projected vertices inside a mask that was judged now."""


def probe_pictures(task: PictureTask) -> tuple[Probe, ...]:
    """The first pass over the pictures of a task, in order."""
    source = load_job(task.job).source
    lens, stored = load_lens(task.job, task.camera)
    split = isinstance(source.reader, SplitReader)
    return tuple(
        probe_picture(source, lens, stored, (task.camera, frame), keep_mask=split)
        for frame in task.frames
    )


def estimate_stage(task: StageTask) -> None:
    """Leaves the stage of a camera beside the job."""
    reader = load_job(task.job).source.reader
    assert isinstance(reader, StageReader)
    reader.save_stage(task.camera, task.job.stage(task.camera))


def encode_pictures(task: EncodeTask) -> tuple[Outcome, ...]:
    """The second pass over the pictures of a task, in order."""
    pictures = task.pictures
    job = load_job(pictures.job)
    lens, _ = load_lens(pictures.job, pictures.camera)
    stage = pictures.job.stage(pictures.camera)
    if isinstance(job.source.reader, StageReader) and stage.is_file():
        job.source.reader.load_stage(pictures.camera, stage)
    raw = _raw_pictures(job.source.reader, task)
    outcomes = []
    for frame, crop, found in zip(pictures.frames, task.crops, raw, strict=True):
        place = (pictures.camera, frame)
        inside, reason = np.nan, ""
        if isinstance(found, Absent):
            outcomes.append(Outcome(*place, None, found.reason, found.where, False))
            continue
        if found.mask is None or not found.mask.any():
            reason = "no mask" if found.mask is None else "empty mask"
        elif task.judge:
            inside, reason = judged_mask(job.source, lens, frame, found.mask)
        if reason:
            where = str(job.source.reader.files(*place)[0])
            outcomes.append(Outcome(*place, None, reason, where, False, inside))
            continue
        picture = stored_picture(found, lens, crop, job.options)
        stored = _encoded(picture, place, task.with_content)
        touching = _touches(picture, crop, stored_size(lens.camera.size, job.options.scale))
        outcomes.append(Outcome(*place, stored, "", "", touching, inside))
    return tuple(outcomes)


def _raw_pictures(reader: FrameReader, task: EncodeTask) -> Iterator[RawPicture | Absent]:
    """The pictures of a task with their masks, which need not be decoded a second time."""
    pictures = task.pictures
    if not (task.masks and all(task.masks) and isinstance(reader, SplitReader)):
        yield from reader.read_many(pictures.camera, pictures.frames)
        return
    images = reader.read_images(pictures.camera, pictures.frames)
    for found, packed in zip(images, task.masks, strict=True):
        if isinstance(found, Absent):
            yield found
        else:
            height, width, _ = found.image.shape
            yield replace(found, mask=unpacked_mask(packed, (width, height)))


def _encoded(picture: Picture, place: tuple[int, int], with_content: bool) -> StoredPicture:
    content = (picture.rgb.tobytes(), picture.alpha.tobytes()) if with_content else None
    return StoredPicture(*place, picture.offset, *encode_picture(picture), content=content)


def _touches(picture: Picture, crop: Crop, size: tuple[int, int]) -> bool:
    """Whether the person continues beyond a border of the crop that is inside the picture."""
    alpha = picture.alpha
    borders = (
        crop.x > 0 and np.any(alpha[:, 0]),
        crop.y > 0 and np.any(alpha[0]),
        crop.x + crop.width < size[0] and np.any(alpha[:, -1]),
        crop.y + crop.height < size[1] and np.any(alpha[-1]),
    )
    return any(map(bool, borders))
