import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.pickles import PickleError
from actorsnerf_preprocess.aist_annotations import (
    read_ignore_list,
    read_keypoints,
    read_mapping,
    read_motion,
    read_setting,
)
from actorsnerf_preprocess.source import SourceError


def motion(frames: int = 3) -> dict[str, Any]:
    return {
        "smpl_poses": np.arange(frames * 72, dtype=np.float32).reshape(frames, 72) / 100,
        "smpl_scaling": np.array([93.5]),
        "smpl_trans": np.ones((frames, 3)),
        "smpl_loss": 0.5,
    }


def written(folder: Path, content: object) -> Path:
    path = folder / "motion.pkl"
    path.write_bytes(pickle.dumps(content))
    return path


@pytest.mark.parametrize("scaling", [93.5, np.float64(93.5), np.array([93.5]), np.array([[93.5]])])
def test_scaling_is_one_number_however_it_is_wrapped(tmp_path: Path, scaling: object) -> None:
    assert read_motion(written(tmp_path, motion() | {"smpl_scaling": scaling})).scaling == 93.5


def test_flat_and_nested_poses_are_the_same(tmp_path: Path) -> None:
    flat = read_motion(written(tmp_path, motion()))
    nested = motion()
    nested["smpl_poses"] = nested["smpl_poses"].reshape(3, 24, 3)
    assert np.array_equal(flat.poses, read_motion(written(tmp_path, nested)).poses)
    np.testing.assert_allclose(flat.poses[1, 0], [0.72, 0.73, 0.74], atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.pop("smpl_scaling"), r"has no entry smpl_scaling \(found smpl_loss"),
        (lambda m: m.update(smpl_scaling=np.array([90.0, 91.0])), "expected one positive number"),
        (lambda m: m.update(smpl_scaling=np.array([-90.0])), "expected one positive number"),
        (lambda m: m.update(smpl_poses=np.zeros((3, 69))), r"shape \(3, 69\), expected \(frames,"),
        (
            lambda m: m.update(smpl_trans=np.zeros((2, 3))),
            r"expected \(3, 3\) as there are 3 poses",
        ),
        (lambda m: m["smpl_trans"].__setitem__((1, 2), np.nan), "1 of 9 numbers are not finite"),
    ],
)
def test_a_wrong_motion_is_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    wrong = motion()
    change(wrong)
    with pytest.raises(SourceError, match=message):
        read_motion(written(tmp_path, wrong))


class Hostile:
    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        return os.mkdir, (str(self.marker),)


def test_a_hostile_pickle_is_refused_and_not_run(tmp_path: Path) -> None:
    marker = tmp_path / "executed"
    with pytest.raises(PickleError, match="mkdir"):
        read_motion(written(tmp_path, motion() | {"smpl_loss": Hostile(marker)}))
    assert not marker.exists()


def test_blanks_and_empty_lines_of_the_ignore_list_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "ignore_list.txt"
    path.write_text("gHO_sFM_cAll_d20_mHO5_ch13 \n\ngBR_sBM_cAll_d04_mBR0_ch01\n\n")
    assert read_ignore_list(path) == {"gHO_sFM_cAll_d20_mHO5_ch13", "gBR_sBM_cAll_d04_mBR0_ch01"}
    assert read_ignore_list(None) == frozenset()


def test_settings_are_opaque_names_and_need_no_last_newline(tmp_path: Path) -> None:
    (tmp_path / "mapping.txt").write_text("a_cAll setting7_1\nb_cAll\tsetting1")
    assert read_mapping(tmp_path / "mapping.txt") == {"a_cAll": "setting7_1", "b_cAll": "setting1"}
    with pytest.raises(SourceError, match="names no camera setting for c_cAll"):
        read_setting(tmp_path, "c_cAll")
    with pytest.raises(SourceError, match=r"setting1\.json: there is no such camera setting"):
        read_setting(tmp_path, "b_cAll")
    (tmp_path / "mapping.txt").write_text("a_cAll\n")
    with pytest.raises(SourceError, match="line 1: 1 columns"):
        read_mapping(tmp_path / "mapping.txt")
    with pytest.raises(SourceError, match="there is no such file"):
        read_mapping(tmp_path / "none.txt")


def test_keypoints_may_hold_nan_but_not_other_joints(tmp_path: Path) -> None:
    points = np.full((9, 4, 17, 3), np.nan)
    path = written(tmp_path, {"keypoints2d": points, "other": np.zeros((4, 16, 3))})
    assert np.isnan(read_keypoints(path, "keypoints2d", 3)).all()
    with pytest.raises(SourceError, match=r"shape \(4, 16, 3\), expected \(\.\.\., 17, 3\)"):
        read_keypoints(path, "other", 3)
