import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from actorsnerf_preprocess.aist_names import PAPER_SEQUENCES
from actorsnerf_preprocess.source import Found, SourceError
from actorsnerf_preprocess.sources import (
    find_sources,
    find_wanted,
    held_out_names,
    require_dataset,
    selected,
    unknown_held_out,
)

WriteTree = Callable[..., Any]


def test_sequences_are_found_two_levels_down(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "zju" / "CoreView_377", frames=range(1), cameras=1)
    write_zju(tmp_path / "CoreView_387", frames=range(1), cameras=1)
    assert [found.name for found in find_sources(tmp_path)] == ["CoreView_377", "CoreView_387"]


def test_a_folder_without_a_data_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="is no data set that can be read; looked for ZJU-MoCap"):
        find_sources(tmp_path)
    with pytest.raises(SourceError, match="no such folder; --source names"):
        find_sources(tmp_path / "gone")


def test_two_data_sets_in_one_folder_are_refused(
    tmp_path: Path, write_zju: WriteTree, write_aist: WriteTree
) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(1), cameras=1)
    write_aist(tmp_path)
    for videos in (True, False):
        if not videos:
            shutil.rmtree(tmp_path / "aist" / "videos")
        with pytest.raises(SourceError, match=r"holds ZJU-MoCap \(CoreView_377.*and AIST\+\+"):
            find_sources(tmp_path)


def test_videos_need_not_be_there_to_be_listed(tmp_path: Path, write_aist: WriteTree) -> None:
    tree = write_aist(tmp_path, frames=2, cameras=1)
    motions = tree.root / "annotations" / "motions"
    other = PAPER_SEQUENCES[3]
    shutil.copy(motions / f"{tree.name}.pkl", motions / f"{other}.pkl")

    def names(*chosen: str) -> list[str]:
        return [found.name for found in find_wanted(tree.root, chosen)]

    assert names() == [tree.name], "what can be prepared"
    assert names(other) == [other]
    shutil.rmtree(tree.root / "videos")
    assert names() == [other], "the paper's"
    (motions / f"{other}.pkl").unlink()
    assert names() == [tree.name]
    with pytest.raises(SourceError, match="1 motions but none of their videos"):
        find_sources(tree.root)


def test_another_data_set_than_asked_for_is_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(1), cameras=1)
    found = find_sources(tmp_path)
    require_dataset(tmp_path, found, None)
    require_dataset(tmp_path, found, "zju-mocap")
    with pytest.raises(SourceError, match=r"holds ZJU-MoCap \(CoreView_377, ...\), but AIST\+\+"):
        require_dataset(tmp_path, found, "aist")
    with pytest.raises(SourceError, match="but synthetic actors was asked for"):
        require_dataset(tmp_path, found, "synthetic")
    drawn = (replace(found[0], dataset="synthetic"),)
    require_dataset(tmp_path, drawn, "synthetic")
    require_dataset(tmp_path, drawn, "zju-mocap")


def test_sequences_are_selected_by_name_or_subject(tmp_path: Path) -> None:
    found = [
        Found(name, tmp_path / name, "ZJU-MoCap", "zju-mocap")
        for name in ("CoreView_377", "CoreView_387")
    ]
    assert selected(found, []) == tuple(found)
    assert selected(found, ["387"]) == (found[1],)
    assert selected(found, ["CoreView_387", "387"]) == (found[1],)
    with pytest.raises(SourceError, match=r"has no sequence '386'; it has CoreView_377, CoreView"):
        selected(found, ["386"])


def test_held_out_actors_are_given_or_in_a_file(tmp_path: Path) -> None:
    assert held_out_names(tmp_path, []) == ()
    (tmp_path / "held_out.txt").write_text("aunt \n\nuncle\n")
    assert held_out_names(tmp_path, []) == ("aunt", "uncle")
    assert held_out_names(tmp_path, ["me"]) == ("me",)


def test_names_of_the_file_that_nobody_has_are_said(tmp_path: Path) -> None:
    found = [
        Found(name, tmp_path / name, "ZJU-MoCap", "zju-mocap")
        for name in ("CoreView_anna", "CoreView_377")
    ]
    file = tmp_path / "held_out.txt"
    assert unknown_held_out(tmp_path, found) == ()
    file.write_text("anna\nzju-377\nCoreView_377\n")
    assert unknown_held_out(tmp_path, found) == ()
    file.write_text("Anna\nuncle\ncoreview_377\naunt\n")
    anna, other, absent = unknown_held_out(tmp_path, found)
    assert "Anna is no actor or sequence here, but anna is" in anna
    assert "coreview_377 is no actor or sequence here, but CoreView_377 is" in other
    assert "hold out nobody: uncle, aunt; there are CoreView_anna, CoreView_377." in absent
