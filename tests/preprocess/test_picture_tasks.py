import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.picture_tasks import EncodeTask, encode_pictures, probe_pictures
from actorsnerf_preprocess.pictures import Crop, PictureOptions, lens_of, stored_picture
from actorsnerf_preprocess.source import OpenOptions, RawPicture, SourceSequence
from actorsnerf_preprocess.workers import Job, JobFile, PictureTask, job_file
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


@pytest.fixture
def source(tmp_path: Path, write_zju: WriteTree, tiny_body: Path) -> SourceSequence:
    write_zju(tmp_path / "CoreView_377", frames=range(3), cameras=1)
    return open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))


@pytest.fixture
def file(tmp_path: Path, source: SourceSequence) -> Iterator[JobFile]:
    with job_file(tmp_path / "job", Job(source, PictureOptions())) as written:
        yield written


def test_probes_come_in_order(file: JobFile) -> None:
    probes = probe_pictures(PictureTask(file, 0, (0, 2)))
    assert [(probe.camera, probe.frame) for probe in probes] == [(0, 0), (0, 2)]
    assert all(probe.box is not None for probe in probes)


def test_chunks_hold_the_stored_picture(file: JobFile, source: SourceSequence) -> None:
    crop = Crop(10, 8, 64, 72)
    (outcome,) = encode_pictures(EncodeTask(PictureTask(file, 0, (1,)), (crop,)))
    raw = next(source.reader.read_many(0, [1]))
    assert isinstance(raw, RawPicture) and outcome.stored is not None
    expected = stored_picture(raw, lens_of(source.cameras[0]), crop, PictureOptions())
    rgb = np.frombuffer(zlib.decompress(outcome.stored.rgb_chunk), np.uint8)
    assert np.array_equal(rgb.reshape(72, 64, 3), expected.rgb)
    assert outcome.stored.offset == (10, 8)
    assert outcome.stored.content is None


def test_contents_are_what_the_chunks_hold(file: JobFile) -> None:
    task = EncodeTask(PictureTask(file, 0, (1,)), (Crop(10, 8, 64, 72),), with_content=True)
    stored = encode_pictures(task)[0].stored
    assert stored is not None and stored.content is not None
    assert stored.content == tuple(map(zlib.decompress, (stored.rgb_chunk, stored.alpha_chunk)))


def test_a_silhouette_cut_by_its_crop_is_reported(file: JobFile) -> None:
    task = PictureTask(file, 0, (0, 1))
    whole, cut = encode_pictures(EncodeTask(task, (Crop(0, 0, 80, 80), Crop(40, 0, 40, 80))))
    assert not whole.touching
    assert cut.touching


def test_lost_pictures_and_empty_masks_are_named(file: JobFile, source: SourceSequence) -> None:
    image, _ = source.reader.files(0, 0)
    image.unlink()
    _, mask = source.reader.files(0, 1)
    cv2.imwrite(str(mask), np.zeros((160, 160), np.uint8))
    crops = (Crop(0, 0, 80, 80),) * 3
    outcomes = encode_pictures(EncodeTask(PictureTask(file, 0, (0, 1, 2)), crops))
    assert [outcome.reason for outcome in outcomes] == ["missing", "empty mask", ""]
    assert [outcome.stored is None for outcome in outcomes] == [True, True, False]


def test_masks_that_were_made_on_the_way_are_judged(file: JobFile, source: SourceSequence) -> None:
    _, mask = source.reader.files(0, 1)
    elsewhere = np.zeros((160, 160), np.uint8)
    elsewhere[:, :12] = 255
    cv2.imwrite(str(mask), elsewhere)
    task = PictureTask(file, 0, (0, 1))
    crops = (Crop(0, 0, 80, 80),) * 2
    good, bad = encode_pictures(EncodeTask(task, crops, judge=True))
    assert good.stored is not None and good.inside > 0.9
    assert bad.stored is None and (bad.reason, bad.inside) == ("mask elsewhere", 0.0)
    assert all(np.isnan(one.inside) for one in encode_pictures(EncodeTask(task, crops)))


def test_kept_masks_give_the_same_chunks_and_are_not_read_again(
    file: JobFile, source: SourceSequence
) -> None:
    task = PictureTask(file, 0, (0, 1, 2))
    probes = probe_pictures(task)
    crops = (Crop(10, 8, 64, 72),) * 3
    again = encode_pictures(EncodeTask(task, crops))
    for frame in range(3):
        source.reader.files(0, frame)[1].unlink()
    kept = encode_pictures(EncodeTask(task, crops, masks=tuple(p.packed for p in probes)))
    assert [outcome.stored for outcome in kept] == [outcome.stored for outcome in again]
    assert all(outcome.stored is not None for outcome in kept)
    source.reader.files(0, 1)[0].unlink()
    lost = encode_pictures(EncodeTask(task, crops, masks=tuple(p.packed for p in probes)))
    assert [outcome.reason for outcome in lost] == ["", "missing", ""]
