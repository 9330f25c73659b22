"""Which filter and which chunks pictures are stored with: bytes, time to write and to read."""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py
import numpy as np
from records import Table, record, timed
from scenes import BODY, SEED, zju_sequence

from actorsnerf_datasets.types import Picture, UInt8
from actorsnerf_preprocess.pictures import PictureOptions, lens_of, stored_camera, stored_picture
from actorsnerf_preprocess.probes import crop_size, placed_crop, probe_picture
from actorsnerf_preprocess.source import OpenOptions, RawPicture
from actorsnerf_preprocess.zju import find_zju, open_zju

PATCH = 32
"""Pixels a side of the patches that a training reads."""


@dataclass(frozen=True)
class Storage:
    """One way to keep pictures in an HDF5 file, RGB and alpha as four channels or apart."""

    name: str
    chunks: Callable[[int, int, int], tuple[int, int, int, int]]
    """From height, width, channels to (pictures, rows, columns, channels)."""
    filter: str | None
    level: int | None = None
    together: bool = False


def whole(height: int, width: int, channels: int) -> tuple[int, int, int, int]:
    """One chunk per picture."""
    return 1, height, width, channels


def planes(height: int, width: int, _: int) -> tuple[int, int, int, int]:
    """One chunk per channel of a picture."""
    return 1, height, width, 1


def tiles(height: int, width: int, channels: int) -> tuple[int, int, int, int]:
    """64 x 64 pixels."""
    return 1, min(64, height), min(64, width), channels


def eight(height: int, width: int, channels: int) -> tuple[int, int, int, int]:
    """Eight pictures in a chunk."""
    return 8, height, width, channels


STORAGES = (
    *(Storage(f"gzip {n}, one chunk per picture", whole, "gzip", n) for n in (1, 2, 3, 4, 6, 9)),
    Storage("lzf, one chunk per picture", whole, "lzf"),
    Storage("none, one chunk per picture", whole, None),
    Storage("gzip 4, RGBA in one chunk", whole, "gzip", 4, together=True),
    Storage("gzip 4, a chunk per channel", planes, "gzip", 4),
    Storage("gzip 4, chunks of 64 x 64 pixels", tiles, "gzip", 4),
    Storage("gzip 4, chunks of eight pictures", eight, "gzip", 4),
)


def main() -> None:
    """Measures both backgrounds and records the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    tables = []
    for kept in (False, True):
        pictures = crops(arguments.pictures, kept)
        rows = [png_row(pictures, arguments.repeats)]
        rows += [row(storage, pictures, arguments.repeats) for storage in STORAGES]
        height, width = pictures[0].alpha.shape
        tables.append(
            Table(
                f"Background {'kept' if kept else 'dropped'}: {len(pictures)} crops of {width} x "
                f"{height}",
                (
                    "storage",
                    "bytes per picture",
                    "of raw",
                    "write, ms",
                    "read, ms",
                    f"read {PATCH} x {PATCH}, ms",
                    "exact",
                ),
                tuple(rows),
                "Times are CPU time per picture; the file is in the page cache. PNG is for "
                "comparison: one RGBA file per picture, OpenCV's default level. The layout takes "
                "gzip 4 and one chunk per picture: higher levels save little and take long, "
                "smaller chunks help only who reads a patch of a picture and no more, lzf is "
                "larger and known to h5py alone.",
            )
        )
    record("storage", "How pictures are stored", SEED, tables)


def crops(count: int, keep_background: bool) -> list[Picture]:
    """Stored pictures of the synthetic ZJU-MoCap sequence, at half size."""
    options = PictureOptions(keep_background=keep_background)
    folder = zju_sequence()
    source = open_zju(find_zju(folder)[0], OpenOptions(body_model=BODY, pairs="all"))
    found = []
    for camera in range(len(source.cameras)):
        lens = lens_of(source.cameras[camera])
        stored = stored_camera(source.cameras[camera], options.scale)
        frames = np.linspace(0, len(source.frames) - 1, count // len(source.cameras)).astype(int)
        for frame in np.unique(frames).tolist():
            probe = probe_picture(source, lens, stored, (camera, frame))
            raw = next(source.reader.read_many(camera, [frame]))
            if probe.box is not None and isinstance(raw, RawPicture):
                found.append((raw, lens, probe.box))
    size = crop_size(box for _, _, box in found)
    return [stored_picture(raw, lens, placed_crop(box, size), options) for raw, lens, box in found]


def row(storage: Storage, pictures: list[Picture], repeats: int) -> tuple[str | float | int, ...]:
    """The figures of one storage."""
    parts = layers(pictures, storage.together)
    raw = sum(layer.nbytes for layer in parts) / len(pictures)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.h5"
        write = timed(lambda: written(path, storage, parts), repeats)
        stored = path.stat().st_size / len(pictures)
        order = np.random.default_rng(SEED).permutation(len(pictures)).tolist()
        with h5py.File(path, rdcc_nbytes=0) as file:
            sets = [file[str(index)] for index in range(len(parts))]
            read = timed(lambda: [one[i] for i in order for one in sets], repeats)
            y, x = parts[0].shape[1] // 2, parts[0].shape[2] // 2
            window = (slice(y, y + PATCH), slice(x, x + PATCH))
            patch = timed(lambda: [one[i, *window] for i in order for one in sets], repeats)
            exact = all(
                np.array_equal(one[:], layer) for one, layer in zip(sets, parts, strict=True)
            )
    count = len(pictures) / 1000
    times = (write.cpu / count, read.cpu / count, patch.cpu / count)
    return storage.name, int(stored), f"{stored / raw:.0%}", *times, "yes" if exact else "NO"


def layers(pictures: list[Picture], together: bool) -> list[UInt8]:
    """(pictures, H, W, channels): RGB and alpha, or both in one."""
    rgb = np.stack([picture.rgb for picture in pictures])
    alpha = np.stack([picture.alpha for picture in pictures])[..., None]
    return [np.concatenate([rgb, alpha], axis=3)] if together else [rgb, alpha]


def written(path: Path, storage: Storage, parts: list[UInt8]) -> None:
    """The file of one storage, picture by picture as a preparation writes it."""
    with h5py.File(path, "w") as file:
        for index, layer in enumerate(parts):
            file.create_dataset(
                str(index),
                data=layer,
                chunks=storage.chunks(*layer.shape[1:]),
                compression=storage.filter,
                compression_opts=storage.level,
            )


def png_row(pictures: list[Picture], repeats: int) -> tuple[str | float | int, ...]:
    """The figures of PNG files."""
    rgba = layers(pictures, together=True)[0]
    encoded = [cv2.imencode(".png", picture)[1] for picture in rgba]
    write = timed(lambda: [cv2.imencode(".png", picture) for picture in rgba], repeats)
    read = timed(lambda: [cv2.imdecode(one, cv2.IMREAD_UNCHANGED) for one in encoded], repeats)
    decoded = np.stack([cv2.imdecode(one, cv2.IMREAD_UNCHANGED) for one in encoded])
    size = sum(one.nbytes for one in encoded) / len(pictures)
    count = len(pictures) / 1000
    return (
        "PNG",
        int(size),
        f"{size * len(pictures) / rgba.nbytes:.0%}",
        write.cpu / count,
        read.cpu / count,
        read.cpu / count,
        "yes" if np.array_equal(decoded, rgba) else "NO",
    )


if __name__ == "__main__":
    main()
