import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_preprocess import prepare
from actorsnerf_preprocess.picture_tasks import encode_pictures
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import (
    Absent,
    OpenOptions,
    RawPicture,
    SourceError,
    SourceSequence,
)
from actorsnerf_preprocess.workers import team
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


@pytest.fixture
def tree(tmp_path: Path, write_zju: WriteTree) -> Any:
    return write_zju(tmp_path / "raw" / "CoreView_377", frames=range(3), cameras=2)


def opened(tree: Any, body: Path) -> SourceSequence:
    return open_zju(find_zju(tree.root)[0], OpenOptions(body_model=body, pairs="all"))


def test_the_prepared_file_passes_its_check(tree: Any, tmp_path: Path, tiny_body: Path) -> None:
    report = prepare_sequence(opened(tree, tiny_body), tmp_path, PrepareOptions())
    assert report is not None
    assert (report.stored, report.asked) == (6, 6)
    findings = check_sequence(tmp_path / "CoreView_377.h5", tiny_body)
    assert [finding for finding in findings if finding.severity != "note"] == []
    assert json.loads((tmp_path / "CoreView_377.json").read_text())["stored"] == 6
    assert cv2.imread(str(tmp_path / "CoreView_377.png")) is not None
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "CoreView_377.h5",
        "CoreView_377.json",
        "CoreView_377.png",
        "raw",
    ]


@pytest.mark.parametrize(("millimetres", "kept"), [(0.999, True), (1.001, False)])
def test_the_check_accepts_the_vertices_that_preparation_accepts(
    write_zju: WriteTree, tmp_path: Path, tiny_body: Path, millimetres: float, kept: bool
) -> None:
    tree = write_zju(tmp_path / "raw" / "CoreView_377", frames=range(12), cameras=1)
    path = tree.root / "new_vertices" / "1.npy"
    vertices = np.load(path).astype(np.float64)
    np.save(path, vertices + np.array([0.0, 0.0, millimetres / 1000]))
    prepare_sequence(opened(tree, tiny_body), tmp_path, PrepareOptions())
    file = tmp_path / "CoreView_377.h5"
    findings = check_sequence(file, tiny_body)
    assert [finding for finding in findings if finding.severity != "note"] == []
    with SequenceFile(file) as sequence:
        fits = sequence.complete_header().fits
    moved = fits.posed_vertices[1] @ fits.world_from_body[1, 2, :3] + fits.world_from_body[1, 2, 3]
    shift = millimetres / 1000 if kept else 0.0
    assert np.allclose(moved, tree.world_vertices[1][:, 2] + shift, atol=2e-6)


def test_more_pictures_than_the_protocol_uses_do_not_change_its_lists(
    write_zju: WriteTree, tmp_path: Path, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "raw" / "CoreView_dancer", frames=range(40), cameras=2, size=96)
    found, protocols = find_zju(tree.root)[0], {}
    for pairs in ("protocol", "all"):
        options = OpenOptions(tiny_body, "all" if pairs == "all" else "protocol", ("dancer",))
        source = open_zju(found, options)
        prepare_sequence(source, tmp_path, PrepareOptions(contact_sheet=False))
        with SequenceFile(tmp_path / f"{found.name}.h5") as sequence:
            protocols[pairs] = sequence.header.protocols
            stored = int(sequence.valid.sum())
    assert protocols["all"] == protocols["protocol"]
    assert {shots.list_name for shots in protocols["all"][0].shots} == {"official", "auto"}
    assert stored == 80


def test_the_file_does_not_depend_on_the_number_of_workers(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    source = opened(tree, tiny_body)
    contents = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        out.mkdir()
        with team(workers) as executor:
            prepare_sequence(source, out, PrepareOptions(workers=workers), executor)
        contents.append((out / "CoreView_377.h5").read_bytes())
    assert contents[0] == contents[1]


def test_a_finished_file_is_left_alone_until_something_changes(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    source = opened(tree, tiny_body)
    options = PrepareOptions(contact_sheet=False)
    assert prepare_sequence(source, tmp_path, options) is not None
    first = (tmp_path / "CoreView_377.h5").read_bytes()
    assert prepare_sequence(source, tmp_path, options) is None
    assert prepare_sequence(source, tmp_path, replace(options, scale=0.25)) is not None
    assert prepare_sequence(source, tmp_path, options) is not None
    assert (tmp_path / "CoreView_377.h5").read_bytes() == first
    os.utime(source.reader.files(1, 2)[1], (time.time() + 10, time.time() + 10))
    assert prepare_sequence(source, tmp_path, options) is not None
    (tmp_path / "CoreView_377.h5").unlink()
    assert prepare_sequence(source, tmp_path, options) is not None


def test_a_killed_run_leaves_no_file_and_the_next_one_is_the_same(
    tree: Any, tmp_path: Path, tiny_body: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = opened(tree, tiny_body)
    whole = tmp_path / "whole"
    whole.mkdir()
    prepare_sequence(source, whole, PrepareOptions(contact_sheet=False))
    encode = encode_pictures
    calls = []

    def killed(task: Any) -> Any:
        calls.append(task)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return encode(task)

    out = tmp_path / "out"
    out.mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(prepare, "encode_pictures", killed)
        with pytest.raises(KeyboardInterrupt):
            prepare_sequence(source, out, PrepareOptions(contact_sheet=False))
    assert list(out.iterdir()) == []
    prepare_sequence(source, out, PrepareOptions(contact_sheet=False))
    assert (out / "CoreView_377.h5").read_bytes() == (whole / "CoreView_377.h5").read_bytes()


def test_unusable_pictures_are_counted_noted_and_not_valid(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    masks, images = tree.root / "mask_cihp" / "Camera_B1", tree.root / "Camera_B2"
    cv2.imwrite(str(masks / "000001.png"), np.zeros((160, 160), np.uint8))
    (images / "000000.jpg").unlink()
    report = prepare_sequence(
        opened(tree, tiny_body), tmp_path, PrepareOptions(contact_sheet=False)
    )
    assert report is not None
    assert {(one.reason, one.count) for one in report.unusable} == {
        ("empty mask", 1),
        ("missing", 1),
    }
    with SequenceFile(tmp_path / "CoreView_377.h5") as file:
        assert file.valid.tolist() == [[True, False, True], [False, True, True]]
        notes = file.header.provenance.notes
        assert "1 of 6 pictures are not stored: empty mask." in notes
        assert "1 of 6 pictures are not stored: missing." in notes
        assert file.header.protocols[0].pretraining_frames == (0, 2)
        assert "1 of 3 pre-training frames are unusable and left out: 1." in notes


def test_nothing_usable_is_refused_and_nothing_written(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    for path in (tree.root / "mask_cihp").rglob("*.png"):
        cv2.imwrite(str(path), np.zeros((160, 160), np.uint8))
    out = tmp_path / "out"
    out.mkdir()
    with pytest.raises(SourceError, match=r"none of the 6 pictures .* is usable: 6 x empty mask"):
        prepare_sequence(opened(tree, tiny_body), out, PrepareOptions())
    assert list(out.iterdir()) == []


class LateReader:
    """A source whose masks are made while reading, and which loses pictures on the way."""

    frames_per_task = 2

    def __init__(self, inner: Any, lost: Sequence[int] = (1,)) -> None:
        self._inner = inner
        self._lost = lost

    def files(self, camera_index: int, frame_index: int) -> tuple[Path, ...]:
        return tuple(self._inner.files(camera_index, frame_index))

    def probe(self, camera_index: int, frame_index: int) -> Any:
        found = self._inner.probe(camera_index, frame_index)
        return found if isinstance(found, Absent) else replace(found, mask=None, digest="")

    def read_many(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        for index, picture in zip(
            frame_indices, self._inner.read_many(camera_index, frame_indices), strict=True
        ):
            yield Absent("video", "no picture") if index in self._lost else picture


def test_sources_that_make_masks_get_a_crop_from_the_body(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    source = opened(tree, tiny_body)
    late = replace(source, reader=LateReader(source.reader))
    report = prepare_sequence(late, tmp_path, PrepareOptions(contact_sheet=False))
    assert report is not None
    assert report.cameras[0].inside == pytest.approx(1.0, abs=0.1)
    assert [(one.reason, one.count) for one in report.unusable] == [("no picture", 2)]
    with SequenceFile(tmp_path / "CoreView_377.h5") as file:
        assert file.valid.tolist() == [[True, False, True]] * 2
        notes = file.header.provenance.notes
        assert notes == report.notes
        assert "2 of 6 pictures are not stored: no picture." in notes
        assert file.header.protocols[0].pretraining_frames == (0, 2)
        assert "1 of 3 pre-training frames are unusable and left out: 1." in notes
        assert not any(
            "pictures with their masks" in path for path, _ in file.header.provenance.source_digests
        )


def test_nothing_stored_in_the_second_pass_is_refused_and_nothing_written(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    (tree.root / "Camera_B2" / "000000.jpg").unlink()
    source = opened(tree, tiny_body)
    late = replace(source, reader=LateReader(source.reader, lost=range(3)))
    out = tmp_path / "out"
    out.mkdir()
    for _ in range(2):  # the second run does not take it for finished
        with pytest.raises(
            SourceError,
            match=r"none of the 6 pictures asked for is usable: 5 x no picture \(video\); "
            r"1 x missing \(.*B2/000000.jpg\): look at that file",
        ):
            prepare_sequence(late, out, PrepareOptions())
        assert list(out.iterdir()) == []


def test_the_background_can_be_kept(tree: Any, tmp_path: Path, tiny_body: Path) -> None:
    options = PrepareOptions(keep_background=True, contact_sheet=False)
    prepare_sequence(opened(tree, tiny_body), tmp_path, options)
    with SequenceFile(tmp_path / "CoreView_377.h5") as file:
        assert file.header.provenance.background == "kept"
        picture = file.picture(0, 0)
        assert (picture.rgb[picture.alpha == 0] > 0).mean() > 0.9


def test_a_folder_that_cannot_be_written_is_a_sentence(
    tree: Any, tmp_path: Path, tiny_body: Path
) -> None:
    with pytest.raises((SourceError, LayoutError), match="could not be written"):
        prepare_sequence(opened(tree, tiny_body), tmp_path / "gone", PrepareOptions())
