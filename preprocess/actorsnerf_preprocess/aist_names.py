"""The names of AIST++: sequences, videos, cameras, dancers, and the thirty of the paper."""

import re
from collections.abc import Sequence

CAMERA_NAMES: tuple[str, ...] = tuple(f"c{number:02d}" for number in range(1, 10))
"""All nine views, in the order of the annotations."""

HELD_OUT_DANCERS: tuple[str, ...] = ("d16", "d17", "d18", "d19", "d20")
"""The five dancers of the paper's 25/5 split that no pre-training sees."""

PAPER_SELECTION = "actorsnerf-30"
"""Name of the paper's selection: one advanced dance of each of the thirty dancers."""

PAPER_SEQUENCES: tuple[str, ...] = (
    "gJS_sFM_cAll_d01_mJS5_ch06",
    "gJS_sFM_cAll_d02_mJS3_ch04",
    "gJS_sFM_cAll_d03_mJS5_ch13",
    "gBR_sFM_cAll_d04_mBR0_ch01",
    "gBR_sFM_cAll_d05_mBR1_ch08",
    "gBR_sFM_cAll_d06_mBR2_ch16",
    "gJB_sFM_cAll_d07_mJB2_ch03",
    "gJB_sFM_cAll_d08_mJB2_ch10",
    "gJB_sFM_cAll_d09_mJB1_ch21",
    "gPO_sFM_cAll_d10_mPO3_ch07",
    "gPO_sFM_cAll_d11_mPO2_ch10",
    "gPO_sFM_cAll_d12_mPO1_ch16",
    "gLO_sFM_cAll_d13_mLO0_ch01",
    "gLO_sFM_cAll_d14_mLO2_ch10",
    "gLO_sFM_cAll_d15_mLO0_ch15",
    "gLH_sFM_cAll_d16_mLH2_ch03",
    "gLH_sFM_cAll_d17_mLH1_ch09",
    "gLH_sFM_cAll_d18_mLH1_ch16",
    "gHO_sFM_cAll_d19_mHO4_ch05",
    "gHO_sFM_cAll_d20_mHO3_ch11",
    "gHO_sFM_cAll_d21_mHO3_ch18",
    "gMH_sFM_cAll_d22_mMH2_ch03",
    "gMH_sFM_cAll_d23_mMH4_ch12",
    "gMH_sFM_cAll_d24_mMH1_ch16",
    "gWA_sFM_cAll_d25_mWA2_ch03",
    "gWA_sFM_cAll_d26_mWA1_ch09",
    "gWA_sFM_cAll_d27_mWA4_ch19",
    "gKR_sFM_cAll_d28_mKR4_ch05",
    "gKR_sFM_cAll_d29_mKR3_ch11",
    "gKR_sFM_cAll_d30_mKR5_ch20",
)
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
