import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_choice import FitChoice, choose_fit, fit_folders

WriteTree = Callable[..., Any]


@pytest.fixture
def tree(tmp_path: Path, write_zju: WriteTree) -> Any:
    return write_zju(tmp_path / "CoreView_377", cameras=1)


def chosen(tree: Any) -> FitChoice:
    return choose_fit(tree.root, tree.frames, tree.model)


def test_new_fits_are_preferred_and_have_pose_blend_shapes(tree: Any) -> None:
    choice = chosen(tree)
    assert (choice.folders.parameters, choice.pose_blend) == ("new_params", True)
    assert choice.findings == ()


def test_old_fits_have_none(tree: Any) -> None:
    shutil.rmtree(tree.root / "new_params")
    choice = chosen(tree)
    assert (choice.folders.parameters, choice.pose_blend) == ("params", False)
    assert "made without pose blend shapes" in choice.sentence


def test_renamed_folders_are_told_by_their_vertices(tree: Any) -> None:
    for name in ("params", "vertices"):
        shutil.rmtree(tree.root / name)
        (tree.root / f"new_{name}").rename(tree.root / name)
    choice = chosen(tree)
    assert (choice.folders.parameters, choice.pose_blend) == ("params", True)
    assert "with pose blend shapes, unlike the released" in choice.findings[0].sentence


def test_fits_paired_with_vertices_of_the_other_fit_are_refused(tree: Any) -> None:
    shutil.rmtree(tree.root / "new_vertices")
    shutil.rmtree(tree.root / "params")
    # new_params moved by a centimetre, so that they fit neither folder as they are ...
    for path in (tree.root / "new_params").iterdir():
        fit = np.load(path, allow_pickle=True).item()
        np.save(path, np.asarray({**fit, "Th": fit["Th"] + 0.01}), allow_pickle=True)
    (tree.root / "new_vertices").mkdir()
    for path in (tree.root / "vertices").iterdir():
        np.save(tree.root / "new_vertices" / path.name, np.load(path) + 0.5)
        np.save(path, np.load(path) + 0.01)
    # ... and vertices/ hold what belongs to new_params (without pose blend shapes).
    with pytest.raises(SourceError, match=r"they fit vertices: the folders of two fits were mixed"):
        chosen(tree)


def test_a_fit_of_another_body_is_refused_with_both_errors(tree: Any) -> None:
    for name in ("new_vertices", "vertices"):
        for path in (tree.root / name).iterdir():
            np.save(path, 1.02 * np.load(path))
    with pytest.raises(SourceError, match=r"mm with pose blend shapes and .* mm without.*neutral"):
        chosen(tree)


def test_a_bad_new_fit_gives_way_to_a_good_old_one_with_a_warning(tree: Any) -> None:
    for path in (tree.root / "new_vertices").iterdir():
        np.save(path, 1.02 * np.load(path))
    choice = chosen(tree)
    assert choice.folders.parameters == "params"
    assert choice.findings[0].severity == "warning"
    assert "new_params: rebuilt vertices differ" in choice.findings[0].sentence


def test_bad_files_do_not_decide(tree: Any) -> None:
    np.save(tree.root / "new_vertices" / "0.npy", np.zeros((192, 3), np.float32))
    (tree.root / "new_vertices" / "1.npy").write_bytes(b"\x93NUMPY cut off")
    (tree.root / "new_params" / "2.npy").write_bytes(b"cut off")
    np.save(tree.root / "new_vertices" / "3.npy", np.load(tree.root / "new_vertices" / "3.npy"))
    assert chosen(tree).folders.parameters == "new_params"


def test_without_vertices_the_name_decides_and_a_warning_says_so(tree: Any) -> None:
    shutil.rmtree(tree.root / "new_vertices")
    choice = chosen(tree)
    assert choice.pose_blend
    assert "unverified, taken to be made with pose blend shapes" in choice.findings[0].sentence


def test_no_fit_at_all_is_refused(tree: Any) -> None:
    with pytest.raises(SourceError, match=r"new_params has no file of any of the 1 frames"):
        choose_fit(tree.root, (99,), tree.model)
    for name in ("new_params", "params"):
        shutil.rmtree(tree.root / name)
    assert fit_folders(tree.root) == ()
    with pytest.raises(SourceError, match="has no folder of SMPL fits, looked for new_params"):
        chosen(tree)
