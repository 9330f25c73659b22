import re

from actorsnerf_datasets.published import AIST_SEQUENCES
from actorsnerf_preprocess.aist_names import (
    CAMERA_NAMES,
    KNOWN_BAD_VIEWS,
    PAPER_SEQUENCES,
    dancer_of,
    expanded_selection,
    sequence_of_video,
    video_name,
)

REAL_NAME = re.compile(
    r"^g(BR|PO|LO|MH|LH|HO|WA|KR|JS|JB)_s(BM|FM)_cAll_d(\d\d)_m([A-Z]{2}\d)_ch(\d\d)$"
)


def test_the_selection_is_one_sequence_of_each_of_thirty_dancers() -> None:
    assert [dancer_of(name) for name in PAPER_SEQUENCES] == [f"d{k:02d}" for k in range(1, 31)]
    assert all(REAL_NAME.match(name) for name in PAPER_SEQUENCES)
    assert dict(zip(AIST_SEQUENCES, PAPER_SEQUENCES, strict=True)) == AIST_SEQUENCES


def test_a_selection_is_replaced_and_other_names_stay() -> None:
    assert expanded_selection(["x", "actorsnerf-30"]) == ("x", *PAPER_SEQUENCES)
    assert expanded_selection([]) == ()


def test_video_and_sequence_names_are_inverse_for_every_camera() -> None:
    for sequence in (*PAPER_SEQUENCES, "gBR_sGR_cAll_d04_d05_d06_mBR0_ch01", "sSH_cAll_v0"):
        for camera in CAMERA_NAMES:
            assert sequence_of_video(video_name(sequence, camera)) == (sequence, camera)


def test_the_first_of_several_dancers_names_the_actor() -> None:
    assert dancer_of("gBR_sGR_cAll_d04_d05_d06_mBR0_ch01") == "d04"
    assert dancer_of("sSH_cAll_v0") == "sSH_cAll_v0"


def test_the_bad_view_is_not_the_papers_sequence_of_the_same_dancer() -> None:
    assert ("gBR_sBM_cAll_d04_mBR0_ch01", "c05") in KNOWN_BAD_VIEWS
    assert not {sequence for sequence, _ in KNOWN_BAD_VIEWS} & set(PAPER_SEQUENCES)
