from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.aist_json import CameraEntry
from actorsnerf_preprocess.aist_names import CAMERA_NAMES
from actorsnerf_preprocess.aist_views import usable_views

SEQUENCE = "gBR_sFM_cAll_d04_mBR0_ch01"


def entry(name: str = "c01") -> CameraEntry:
    return CameraEntry(
        name=name,
        index=int(name[1:]) - 1,
        size=(160, 90),
        K=np.array([[120.0, 0, 80], [0, 120.0, 45], [0, 0, 1]]),
        R=np.eye(3),
        translation=np.array([10.0, 20.0, 450.0]),
        distortion=np.array([-0.1, 0, 0, 0, 0]),
    )


def video(path: Path, size: tuple[int, int] = (160, 90), count: int = 12) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, size)
    for _ in range(count):
        writer.write(np.full((size[1], size[0], 3), 90, np.uint8))
    writer.release()
    return path


def test_all_is_divided_by_the_scaling_and_nothing_else_changes(tmp_path: Path) -> None:
    entries = tuple(entry(name) for name in CAMERA_NAMES)
    path = video(tmp_path / "v.mp4")
    views, findings = usable_views(
        SEQUENCE, entries, dict.fromkeys(CAMERA_NAMES, path), scaling=90.0, frame_count=12
    )
    assert findings == ()
    assert [view.camera.name for view in views] == list(CAMERA_NAMES)
    camera = views[2].camera
    np.testing.assert_allclose(camera.T, [10 / 90, 20 / 90, 5.0])
    assert np.array_equal(camera.K, entry().K) and camera.size == (160, 90)
    assert camera.source_index == 2 and camera.distortion[0] == -0.1


def test_a_resized_video_has_resized_intrinsics(tmp_path: Path) -> None:
    videos = {"c01": video(tmp_path / "v.mp4", (80, 45 + 1))}
    (view,), findings = usable_views(
        SEQUENCE, (replace(entry(), size=(160, 92)),), videos, 90.0, 12
    )
    # A scale s maps the centre c to (c + 0.5) s - 0.5.
    np.testing.assert_allclose(view.camera.K[0], [60.0, 0, 80.5 / 2 - 0.5])
    assert any("intrinsics are resized with it" in each.sentence for each in findings)


@pytest.mark.parametrize(
    ("sequence", "size", "sentence"),
    [
        (SEQUENCE, (64, 48), "is 64 x 48, but 160 x 90 was calibrated, another shape"),
        ("gBR_sBM_cAll_d04_mBR0_ch01", (160, 90), "is not synchronised with the other views"),
    ],
)
def test_a_bad_view_is_left_out_with_a_sentence(
    tmp_path: Path, sequence: str, size: tuple[int, int], sentence: str
) -> None:
    videos = {"c05": video(tmp_path / "v.mp4", size)}
    views, findings = usable_views(sequence, (entry("c05"),), videos, 90.0, 12)
    assert views == ()
    assert any(sentence in each.sentence and "left out" in each.sentence for each in findings)


def test_missing_and_broken_videos_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    videos = {"c01": video(tmp_path / "v.mp4"), "c02": broken}
    entries = tuple(entry(name) for name in ("c01", "c02", "c03"))
    views, findings = usable_views(SEQUENCE, entries, videos, 90.0, 12)
    assert [view.camera.name for view in views] == ["c01"]
    found = {each.entry: each.sentence for each in findings}
    assert "cannot open this video" in found["c02"]
    assert found["c03"] == "there is no video of this view; it is left out."
    assert found["c09"] == f"{SEQUENCE} has no camera c09 in its setting."


@pytest.mark.parametrize(("frame_count", "reported"), [(11, 0), (12, 0), (13, 0), (14, 1)])
def test_a_length_that_differs_by_more_than_one_is_reported(
    tmp_path: Path, frame_count: int, reported: int
) -> None:
    videos = {"c01": video(tmp_path / "v.mp4")}
    _, findings = usable_views(SEQUENCE, (entry(),), videos, 90.0, frame_count)
    said = [each.sentence for each in findings if "the shorter is used" in each.sentence]
    assert len(said) == reported
    if reported:
        assert said[0].startswith("covers 12 instants at 60 per second (12 pictures at 60.000)")


def test_unusual_lenses_are_noted(tmp_path: Path) -> None:
    odd = replace(
        entry(),
        K=np.array([[120.0, 0, 70], [0, 121.0, 45], [0, 0, 1]]),
        distortion=np.array([-0.1, 0.2, 0, 0, 0]),
    )
    _, findings = usable_views(SEQUENCE, (odd,), {"c01": video(tmp_path / "v.mp4")}, 90.0, 12)
    (note,) = [each for each in findings if each.severity == "note"]
    for words in ("fx 120 and fy 121 differ", "the centre is 70, 45", "more than k1"):
        assert words in note.sentence
