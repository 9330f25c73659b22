import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess import aist_reader
from actorsnerf_preprocess.aist import open_aist
from actorsnerf_preprocess.aist_reader import AistReader
from actorsnerf_preprocess.backgrounds import Background
from actorsnerf_preprocess.masks import mask_scores
from actorsnerf_preprocess.source import (
    Absent,
    Found,
    MaskProbe,
    OpenOptions,
    RawPicture,
    SourceError,
    SourceSequence,
    StageReader,
)


def opened(tree: Any, **changes: Any) -> SourceSequence:
    found = Found(tree.name, tree.root, "AIST++", "aist++")
    return open_aist(found, OpenOptions(body_model=tree.body, pairs="all", **changes))


def backdrop(source: SourceSequence, camera: int) -> Background:
    assert isinstance(source.reader, AistReader)
    return source.reader.background(camera)


def mask_of(picture: RawPicture | Absent | MaskProbe) -> UInt8:
    assert isinstance(picture, RawPicture | MaskProbe) and picture.mask is not None
    return picture.mask


def truth(tree: Any, camera: str, frame: int) -> UInt8:
    name = tree.name.replace("cAll", camera)
    return np.asarray(cv2.imread(str(tree.masks / name / f"{frame:06d}.png"), 0), np.uint8)


def test_made_masks_find_the_dancer(aist: Any) -> None:
    reader = opened(aist).reader
    overlaps = [
        mask_scores(mask_of(picture), truth(aist, name, frame))[0]
        for camera, name in enumerate(aist.names)
        for frame, picture in enumerate(reader.read_many(camera, range(8)))
    ]
    # The dancer is 50 pixels tall here and made of single boxes: an outline is a large share.
    assert np.mean(overlaps) > 0.8 and np.min(overlaps) > 0.65


def test_the_background_has_no_dancer_in_it(aist: Any) -> None:
    source = opened(aist)
    background = backdrop(source, 0)
    red = background.picture[..., 0].astype(int) - background.picture[..., 2]
    assert (red[background.known] < 90).mean() > 0.995
    assert background.picture.shape == (108, 192, 3)


def test_given_masks_come_before_made_ones(aist: Any) -> None:
    source = opened(aist, masks=aist.masks)
    assert source.mask_source == "given by the user"
    pictures = list(source.reader.read_many(1, [2, 5]))
    for frame, picture in zip((2, 5), pictures, strict=True):
        assert np.array_equal(mask_of(picture), truth(aist, "c02", frame))
        assert np.array_equal(mask_of(source.reader.probe(1, frame)), mask_of(picture))
    video, mask = source.reader.files(1, 5)
    assert video.name == f"{aist.name.replace('cAll', 'c02')}.mp4" and mask.name == "000005.png"


def test_made_masks_cost_nothing_in_the_first_pass(aist: Any) -> None:
    assert opened(aist).reader.probe(0, 0) == MaskProbe(None, "")


def test_a_missing_given_mask_is_no_mask_and_is_not_made(aist: Any) -> None:
    (aist.masks / aist.name.replace("cAll", "c01") / "000003.png").unlink()
    source = opened(aist, masks=aist.masks)
    (picture,) = source.reader.read_many(0, [3])
    assert isinstance(picture, RawPicture) and picture.mask is None


def test_views_without_given_masks_are_made_and_that_is_recorded(aist: Any) -> None:
    for path in (aist.masks / aist.name.replace("cAll", "c03")).iterdir():
        path.unlink()
    source = opened(aist, masks=aist.masks)
    assert source.mask_source.startswith("given by the user for 2 views; for the rest made:")
    (picture,) = source.reader.read_many(2, [3])
    assert isinstance(picture, RawPicture) and picture.mask is not None


def test_frames_past_the_end_of_one_video_are_absent(aist: Any) -> None:
    path = aist.root / "videos" / f"{aist.name.replace('cAll', 'c02')}.mp4"
    picture = np.full((108, 192, 3), 90, np.uint8)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (192, 108))
    for _ in range(4):
        writer.write(picture)
    writer.release()
    source = opened(aist, masks=aist.masks)
    kinds = [type(each) for each in source.reader.read_many(1, range(2, 6))]
    assert kinds == [RawPicture, RawPicture, Absent, Absent]
    assert any("the shorter is used" in each.sentence for each in source.findings)


def test_a_video_that_vanishes_is_absent_for_every_frame(aist: Any) -> None:
    source = opened(aist)
    (aist.root / "videos" / f"{aist.name.replace('cAll', 'c01')}.mp4").unlink()
    absent = list(source.reader.read_many(0, [1, 2, 3]))
    assert len(absent) == 3
    for each in absent:
        assert isinstance(each, Absent) and "there is no such video" in each.reason


@pytest.mark.parametrize("frames", [(0, 1, 2, 3, 4, 5, 6, 7), (6, 7)])
def test_a_copy_in_another_process_reads_the_same(aist: Any, frames: tuple[int, ...]) -> None:
    reader = opened(aist).reader
    first = list(reader.read_many(0, range(8)))
    copy = pickle.loads(pickle.dumps(reader))
    for index, picture in zip(frames, copy.read_many(0, frames), strict=True):
        expected = first[index]
        assert isinstance(picture, RawPicture) and isinstance(expected, RawPicture)
        assert np.array_equal(picture.image, expected.image)
        assert np.array_equal(mask_of(picture), mask_of(expected))


def test_the_pickled_reader_carries_no_background(aist: Any) -> None:
    source = opened(aist)
    before = len(pickle.dumps(source.reader))
    backdrop(source, 0)
    assert len(pickle.dumps(source.reader)) == before


def test_a_shared_stage_is_the_estimated_one_and_is_not_estimated_again(
    aist: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = opened(aist).reader
    assert isinstance(reader, StageReader) and isinstance(reader, AistReader)
    assert reader.needs_stage(1)
    copy = pickle.loads(pickle.dumps(reader))
    reader.save_stage(1, tmp_path / "stage")
    expected = next(reader.read_many(1, [5]))

    def again(_: object) -> None:
        raise AssertionError("estimated again")

    monkeypatch.setattr(aist_reader, "estimate_background", again)
    with pytest.raises(AssertionError, match="estimated again"):
        next(copy.read_many(1, [5]))
    copy.load_stage(1, tmp_path / "stage")
    for name in ("picture", "noise", "known"):
        ours, theirs = getattr(copy.background(1), name), getattr(reader.background(1), name)
        assert np.array_equal(ours, theirs) and ours.dtype == theirs.dtype
    assert np.array_equal(mask_of(next(copy.read_many(1, [5]))), mask_of(expected))


def test_no_stage_is_left_of_a_video_that_cannot_be_decoded(aist: Any, tmp_path: Path) -> None:
    reader = opened(aist).reader
    assert isinstance(reader, StageReader)
    reader.files(0, 0)[0].unlink()
    reader.save_stage(0, tmp_path / "stage")
    assert not (tmp_path / "stage").exists()


def test_a_stage_that_cannot_be_written_is_a_sentence(aist: Any, tmp_path: Path) -> None:
    reader = opened(aist).reader
    assert isinstance(reader, StageReader)
    with pytest.raises(SourceError, match=r"gone/stage: could not be written .* disk full\?"):
        reader.save_stage(0, tmp_path / "gone" / "stage")


def test_given_masks_need_no_stage(aist: Any) -> None:
    reader = opened(aist, masks=aist.masks).reader
    assert isinstance(reader, StageReader)
    assert not any(reader.needs_stage(camera) for camera in range(3))


def test_files_exist(aist: Any) -> None:
    source = opened(aist)
    assert all(isinstance(path, Path) and path.is_file() for path in source.reader.files(2, 7))
