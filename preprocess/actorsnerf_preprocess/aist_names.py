"""The names of AIST++: sequences, videos, cameras, dancers, and the thirty of the paper."""

import re
from collections.abc import Sequence

from actorsnerf_datasets.published import AIST_SEQUENCES

CAMERA_NAMES: tuple[str, ...] = tuple(f"c{number:02d}" for number in range(1, 10))
"""All nine views, in the order of the annotations."""

PAPER_SELECTION = "actorsnerf-30"
"""Name of the paper's selection: one advanced dance of each of the thirty dancers."""

PAPER_SEQUENCES: tuple[str, ...] = tuple(AIST_SEQUENCES.values())
"""As in the released preparation script; none of them is on the data set's ignore list."""

KNOWN_BAD_VIEWS: dict[tuple[str, str], str] = {
    ("gBR_sBM_cAll_d04_mBR0_ch01", "c05"): "is not synchronised with the other views",
    ("gJB_sBM_cAll_d07_mJB3_ch05", "c07"): "is 640 x 480, another picture than was calibrated",
}
"""(sequence, camera) that the data set's own scripts leave out, and why."""

_CAMERA_TAG = re.compile(r"(?<=_)c\d\d(?=_)")
_DANCER_TAG = re.compile(r"_(d\d\d)(?=_)")


def video_name(sequence: str, camera: str) -> str:
    """The video's file name, without its ending, of one camera of a sequence.

    >>> video_name("gLH_sFM_cAll_d16_mLH2_ch03", "c01")
    'gLH_sFM_c01_d16_mLH2_ch03'
    """
    return sequence.replace("_cAll", f"_{camera}", 1)


def sequence_of_video(name: str) -> tuple[str, str] | None:
    """The (sequence, camera) that a video's file name stands for; None if it is no such name.

    >>> sequence_of_video("gLH_sFM_c01_d16_mLH2_ch03")
    ('gLH_sFM_cAll_d16_mLH2_ch03', 'c01')
    >>> sequence_of_video("holiday") is None
    True
    """
    tag = _CAMERA_TAG.search(name)
    if tag is None:
        return None
    return name[: tag.start()] + "cAll" + name[tag.end() :], tag.group()


def dancer_of(sequence: str) -> str:
    """The dancer's tag, the first of several; the whole name where there is none.

    >>> dancer_of("gLH_sFM_cAll_d16_mLH2_ch03")
    'd16'
    """
    tag = _DANCER_TAG.search(sequence)
    return tag.group(1) if tag else sequence


def expanded_selection(names: Sequence[str]) -> tuple[str, ...]:
    """The sequences that names stand for: `actorsnerf-30` is replaced by the paper's thirty.

    >>> len(expanded_selection(["actorsnerf-30"])), expanded_selection(["gBR_x"])
    (30, ('gBR_x',))
    """
    return tuple(
        sequence
        for name in names
        for sequence in (PAPER_SEQUENCES if name == PAPER_SELECTION else (name,))
    )
