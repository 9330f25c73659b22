import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_preprocess.aist_inspection import (
    annotation_digests,
    chosen_frames,
    inspect_aist,
)
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError


def found_of(tree: Any) -> Found:
    return Found(tree.name, tree.root, "AIST++", "aist++")


@pytest.mark.parametrize(
    ("length", "first", "last", "step"),
    [
        (2200, 200, 2196, 4),
        (437, 200, 436, 4),  # 60 frames remain, the least that counts.
        (436, 0, 432, 4),
        (240, 0, 236, 4),
        (239, 0, 238, 1),
    ],
)
def test_the_papers_frames_are_used_where_enough_remain(
    length: int, first: int, last: int, step: int
) -> None:
    frames, sentence = chosen_frames(length)
    assert (frames[0], frames[-1]) == (first, last)
    assert np.unique(np.diff(frames)).tolist() == [step]
    assert ("as in the published experiments" in sentence) == (first == 200)


def test_position_499_of_the_paper_is_frame_2196() -> None:
    assert chosen_frames(2400)[0][499] == 2196


def test_the_shorter_of_motion_and_videos_counts(aist: Any) -> None:
    seen = inspect_aist(found_of(aist), OpenOptions())
    assert seen.frames.tolist() == list(range(8))
    assert any("smpl_scaling 93" in note for note in seen.notes)
    assert any("k/60 s by time stamps" in note for note in seen.notes)


def test_all_pairs_are_all_frames_and_the_protocol_keeps_its_own(
    write_aist: Any, tmp_path: Path
) -> None:
    tree = write_aist(tmp_path, cameras=1, frames=244, size=(64, 36))
    some = inspect_aist(found_of(tree), OpenOptions())
    every = inspect_aist(found_of(tree), OpenOptions(pairs="all"))
    assert some.frames.tolist() == list(range(0, 244, 4))
    assert every.frames.tolist() == list(range(244))
    assert every.protocol_frames.tolist() == some.protocol_frames.tolist() == some.frames.tolist()
    (note,) = [note for note in every.notes if note.startswith("All 244 frames (60 per second)")]
    assert "The protocol keeps to its own: Too short for frames 200, 204" in note
    assert not any(note.startswith("All") for note in some.notes)


def test_the_ignore_list_refuses_and_can_be_overruled(aist: Any) -> None:
    listed = aist.root / "annotations" / "ignore_list.txt"
    listed.write_text(f"{aist.name} \n")
    with pytest.raises(SourceError, match=f"ignore_list.txt: lists {aist.name}") as refusal:
        inspect_aist(found_of(aist), OpenOptions())
    assert "--accept-ignored" in str(refusal.value)
    seen = inspect_aist(found_of(aist), OpenOptions(ignored="accept"))
    assert any("was accepted" in finding.sentence for finding in seen.findings)


def test_masks_of_another_sequence_are_refused(aist: Any, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    with pytest.raises(SourceError, match=f"holds no masks of {aist.name}; expected folders"):
        inspect_aist(found_of(aist), OpenOptions(masks=tmp_path / "other"))


def test_without_a_usable_view_every_reason_is_given(aist: Any) -> None:
    for path in (aist.root / "videos").iterdir():
        path.write_bytes(b"")
    with pytest.raises(SourceError, match="no view is usable") as refusal:
        inspect_aist(found_of(aist), OpenOptions())
    assert str(refusal.value).count("cannot open this video") == 3


def test_a_folder_without_annotations_is_refused(aist: Any, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(SourceError, match=r"there are no AIST\+\+ annotations below it"):
        inspect_aist(replace(found_of(aist), path=empty), OpenOptions())


def test_digests_are_of_the_files_the_sequence_needs(aist: Any) -> None:
    seen = inspect_aist(found_of(aist), OpenOptions())
    digests = dict(annotation_digests(found_of(aist), seen))
    assert list(digests) == [
        "annotations/cameras/mapping.txt",
        "annotations/cameras/setting7_1.json",
        f"annotations/motions/{aist.name}.pkl",
    ]
    setting = aist.root / "annotations" / "cameras" / "setting7_1.json"
    expected = hashlib.sha256(setting.read_bytes()).hexdigest()
    assert digests["annotations/cameras/setting7_1.json"] == expected


def test_cameras_are_matched_by_name_and_not_by_order(aist: Any) -> None:
    setting = aist.root / "annotations" / "cameras" / "setting7_1.json"
    entries = json.loads(setting.read_text())
    straight = inspect_aist(found_of(aist), OpenOptions()).views
    setting.write_text(json.dumps(entries[::-1]))
    turned = inspect_aist(found_of(aist), OpenOptions()).views
    for one, other in zip(straight, turned[::-1], strict=True):
        assert one.camera.name == other.camera.name
        assert np.array_equal(one.camera.T, other.camera.T)
        assert one.video.path == other.video.path
