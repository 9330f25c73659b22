"""How long a preparation would take and how much disk it would use, from a few pictures."""

import time
from dataclasses import dataclass

import cv2
import numpy as np

from actorsnerf_datasets.writer import encode_picture
from actorsnerf_preprocess.pictures import PictureOptions, lens_of, stored_camera, stored_picture
from actorsnerf_preprocess.probes import crop_size, placed_crop, probe_picture
from actorsnerf_preprocess.source import Absent, SourceSequence

SAMPLES = 8


@dataclass(frozen=True)
class Estimate:
    """What a run would cost."""

    pictures: int
    seconds: float
    """With one worker."""
    bytes: int
    sampled: int


def estimate(source: SourceSequence, options: PictureOptions) -> Estimate:
    """The cost of preparing a sequence, from pictures spread over the first wanted camera.

    Args:
        source: the opened sequence.
        options: how pictures are stored.
    """
    cv2.setNumThreads(1)
    total = int(source.wanted.sum())
    camera = int(np.flatnonzero(source.wanted.any(axis=1))[0])
    frames = np.flatnonzero(source.wanted[camera])
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, SAMPLES).astype(int))]
    lens = lens_of(source.cameras[camera])
    stored = stored_camera(source.cameras[camera], options.scale)
    started = time.perf_counter()
    probes = [probe_picture(source, lens, stored, (camera, int(frame))) for frame in frames]
    boxes = {probe.frame: probe.box for probe in probes if probe.box is not None}
    sizes: list[int] = []
    if boxes:
        size = crop_size(boxes.values())
        raws = source.reader.read_many(camera, sorted(boxes))
        for frame, raw in zip(sorted(boxes), raws, strict=True):
            if not isinstance(raw, Absent) and raw.mask is not None:
                picture = stored_picture(raw, lens, placed_crop(boxes[frame], size), options)
                sizes.append(sum(map(len, encode_picture(picture))))
    seconds = (time.perf_counter() - started) / len(frames) * total
    vertices = source.fits.posed_vertices.nbytes
    per_picture = float(np.mean(sizes)) if sizes else 0.0
    return Estimate(total, seconds, int(per_picture * total + vertices), len(sizes))
