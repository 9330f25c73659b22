import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from actorsnerf_preprocess.pictures import PictureOptions
from actorsnerf_preprocess.resume import pictures_digest, settings_digest
from actorsnerf_preprocess.source import OpenOptions
from actorsnerf_preprocess.zju import find_zju, open_zju

WriteTree = Callable[..., Any]


def test_everything_that_decides_the_file_changes_the_digest(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_zju(tmp_path / "CoreView_377", frames=range(2), cameras=2)
    options = PictureOptions()
    found = find_zju(tmp_path)[0]
    source = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    again = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    first = settings_digest(source, options)
    assert settings_digest(again, options) == first
    fewer = source.wanted.copy()
    fewer[1, 1] = False
    digests = {
        settings_digest(source, replace(options, scale=0.25)),
        settings_digest(source, replace(options, keep_background=True)),
        settings_digest(replace(source, wanted=fewer), options),
        settings_digest(replace(source, actor="someone"), options),
        settings_digest(replace(source, cameras=source.cameras[::-1]), options),
    }
    assert len(digests | {first}) == 6
    mask = source.reader.files(1, 0)[1]
    os.utime(mask, (1, 1))
    touched = settings_digest(source, options)
    mask.unlink()
    gone = settings_digest(source, options)
    monkeypatch.setattr("actorsnerf_preprocess.resume.PREPARATION", 0)
    assert len({first, touched, gone, settings_digest(source, options)}) == 4


def test_pictures_have_one_digest_in_order() -> None:
    assert pictures_digest(["a", "b"]) != pictures_digest(["b", "a"])
    assert pictures_digest(["", ""]) == ""
    assert pictures_digest(["", "a"]) == pictures_digest(["a"])
