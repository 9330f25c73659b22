import shutil
from pathlib import Path
from typing import Protocol

import h5py
import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import DataFile, Origin
from actorsnerf_train.data_files import (
    background_of,
    check_files,
    describe_file,
    refuse_leakage,
    training_files,
)


class People(Protocol):
    folder: Path
    ann: Path
    ben: Path
    eve: Path


def test_of_a_folder_the_held_out_are_left_out_and_named(people: People) -> None:
    files, left_out = training_files((people.folder,))
    assert [path.name for path in files] == ["ann.h5", "ben.h5"]
    assert left_out == ("eve.h5: actor eve is held out for testing",)
    named, left_out = training_files((people.eve, people.ann))
    assert (named, left_out) == ((people.eve, people.ann), ())


def test_a_file_that_is_named_twice_counts_once(people: People) -> None:
    again = people.folder / ".." / people.folder.name / "ann.h5"
    files, _ = training_files((people.folder, people.ann, again))
    assert [path.name for path in files] == ["ann.h5", "ben.h5"]


def test_an_actor_held_out_in_one_file_is_left_out_of_all(people: People, known_eve: Path) -> None:
    """Named or in a folder, and whichever comes first."""
    line = "known.h5: actor eve is held out for testing in eve.h5"
    for data in ((people.folder, known_eve), (known_eve.parent, people.folder)):
        files, left_out = training_files(data)
        assert [path.name for path in files] == ["ann.h5", "ben.h5"]
        assert line in left_out
    files, left_out = training_files((known_eve, people.eve, people.ann))
    assert (files, left_out) == ((people.eve, people.ann), (line,))
    assert training_files((known_eve, people.ann))[1] == ()


def test_folders_without_anything_to_train_on(people: People, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"holds no prepared file \(\*\.h5\): prepare a download"):
        training_files((tmp_path,))
    shutil.copy(people.eve, tmp_path)
    with pytest.raises(UserError, match="every actor is held out for testing"):
        training_files((tmp_path,))


def test_a_damaged_file_is_refused_with_its_first_finding(people: People, tmp_path: Path) -> None:
    check_files((people.ann,))
    broken = tmp_path / "a broken.h5"
    shutil.copy(people.ann, broken)
    with h5py.File(broken, "r+") as file:
        file["cameras/K"][0, 0, 0] = -5
    with pytest.raises(UserError, match=r"broken\.h5: fails its check: .*check '.*/a broken\.h5'$"):
        check_files((broken,))


def test_each_data_set_has_its_background(people: People, tmp_path: Path) -> None:
    white = tmp_path / "dancer.h5"
    shutil.copy(people.ann, white)
    with h5py.File(white, "r+") as file:
        file.attrs["dataset"] = "aist++"
    assert background_of((people.ann, people.ben)) == (0.0, 0.0, 0.0)
    assert background_of((white,)) == (1.0, 1.0, 1.0)
    with pytest.raises(UserError, match=r"ann\.h5 is of a data set on black and .*dancer\.h5 of"):
        background_of((people.ann, white))


def test_a_known_actor_is_refused(people: People) -> None:
    file = describe_file(people.ann)
    assert (file.actor, file.sequence, len(file.digest)) == ("ann", "ann-walks", 64)
    origin = Origin("resnet18", False, "ab", 10, (DataFile("a.h5", "s", "ann", "cd"),))
    with pytest.raises(UserError, match=r"actor ann was in the category training already \(a\.h5"):
        refuse_leakage("ann", people.ann, origin)
    refuse_leakage("ben", people.ben, origin)
