from pathlib import Path

import cv2
import numpy as np
import pytest

from actorsnerf_preprocess.aist_video import (
    picture_per_frame,
    pictures_at,
    probe_video,
    spread_pictures,
)
from actorsnerf_preprocess.source import SourceError

STEPS = 32
"""A picture's number is written as two grey levels, its high and its low digit."""


def written(path: Path, count: int, rate: float = 60.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, (64, 48))
    for number in range(count):
        picture = np.empty((48, 64, 3), np.uint8)
        picture[:, :32] = 7 * (number // STEPS)
        picture[:, 32:] = 7 * (number % STEPS)
        writer.write(picture)
    writer.release()
    return path


def number_of(picture: np.ndarray) -> int:
    high, low = float(picture[8:40, 8:24].mean()), float(picture[8:40, 40:56].mean())
    return STEPS * round(high / 7) + round(low / 7)


def test_a_60_hz_video_gives_picture_k_for_frame_k(tmp_path: Path) -> None:
    video = written(tmp_path / "v.mp4", 40)
    frames = [0, 1, 7, 8, 39]
    assert [(k, number_of(p)) for k, p in pictures_at(video, frames)] == [(k, k) for k in frames]


@pytest.mark.parametrize("rate", [59.94, 30.0, 50.0, 100.0])
def test_frames_are_found_by_time_at_any_rate(tmp_path: Path, rate: float) -> None:
    video = written(tmp_path / "v.mp4", 60, rate)
    frames = list(range(0, int(59 * 60 / rate), 3))
    for frame, picture in pictures_at(video, frames):
        shown_at = 60.0 * number_of(picture) / rate
        next_at = shown_at + 60.0 / rate
        # The last picture that starts at most half a tick after the instant.
        assert shown_at <= frame + 0.5 < next_at


def test_counting_would_drift_where_time_does_not(tmp_path: Path) -> None:
    video = written(tmp_path / "v.mp4", 1000, 58.0)
    ((_, picture),) = pictures_at(video, [900])
    assert number_of(picture) == 870


def test_a_seek_leads_to_the_same_pictures_as_a_walk(tmp_path: Path) -> None:
    video = written(tmp_path / "v.mp4", 400, 59.94)
    walked = [number_of(picture) for _, picture in pictures_at(video, range(0, 400, 5))]
    late = [number_of(picture) for _, picture in pictures_at(video, range(300, 400, 5))]
    assert late == walked[60:]


def test_frames_past_the_end_are_left_out(tmp_path: Path) -> None:
    video = written(tmp_path / "v.mp4", 20)
    assert [frame for frame, _ in pictures_at(video, [18, 19, 20, 30])] == [18, 19]
    assert [p is None for p in picture_per_frame(video, [18, 25])] == [False, True]
    assert list(pictures_at(video, [500])) == []
    assert list(pictures_at(video, [])) == []


def test_pictures_are_rgb(tmp_path: Path) -> None:
    path = tmp_path / "red.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (64, 48))
    writer.write(np.full((48, 64, 3), (10, 20, 240), np.uint8))
    writer.release()
    ((_, picture),) = pictures_at(path, [0])
    np.testing.assert_allclose(picture.mean((0, 1)), [240, 20, 10], atol=8)


def test_descending_frames_are_a_programming_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="have to ascend"):
        list(pictures_at(written(tmp_path / "v.mp4", 3), [2, 1]))


def test_the_probe_says_size_rate_and_length(tmp_path: Path) -> None:
    facts = probe_video(written(tmp_path / "v.mp4", 90, 30.0))
    assert (facts.size, facts.rate, facts.picture_count) == ((64, 48), 30.0, 90)
    assert facts.annotated_frames == 180


def test_a_missing_and_a_cut_video_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="there is no such video"):
        probe_video(tmp_path / "none.mp4")
    video = written(tmp_path / "v.mp4", 30)
    video.write_bytes(video.read_bytes()[:400])
    with pytest.raises(SourceError, match="OpenCV cannot open this video"):
        probe_video(video)


def test_a_sample_comes_with_its_own_time(tmp_path: Path) -> None:
    video = written(tmp_path / "v.mp4", 120)
    for stamp, picture in spread_pictures(video, [0.0, 0.5, 1.2]):
        assert number_of(picture) == round(60 * stamp)
