from pathlib import Path
from typing import TYPE_CHECKING

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.notes import COLLAPSED, collapses, table_notes
from actorsnerf_train.tables.table import make_table

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult


def notes(folder: Path) -> str:
    entries = gather([folder / "results"])
    return "\n".join(table_notes(entries, make_table(entries, "box")))


def test_a_row_that_lacks_an_actor_says_so(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    write((25.0, 0.9, 50.0), actor="zoe")
    write((24.0, 0.9, 60.0), method="humannerf")
    text = notes(tmp_path)
    assert "**Missing actors**: HumanNeRF, fewshot-5 (official list) has no result of zoe." in text
    assert text.count("Missing") == 1


def test_a_row_with_fewer_seeds_says_so(write: "WriteResult", tmp_path: Path) -> None:
    for seed in (0, 1):
        write((25.0, 0.9, 50.0), seed=seed)
    write((24.0, 0.9, 60.0), method="humannerf")
    write((24.0, 0.9, 60.0), setting="fewshot-10")  # other settings may have fewer
    text = notes(tmp_path)
    said = "**Missing seeds** (of 2): HumanNeRF, fewshot-5 (official list) has of eve 1, mean 1."
    assert said in text
    assert text.count("Missing") == 1


def test_a_row_of_several_categories_says_so(write: "WriteResult", tmp_path: Path) -> None:
    """A recorded study may be continued on another machine, whose category is another."""
    write((25.0, 0.9, 50.0))
    assert "category trainings" not in notes(tmp_path)
    write((26.0, 0.9, 45.0), setting="fewshot-10", pretrained_from="e" * 64)
    assert "**Several category trainings** (2) are behind ActorsNeRF" in notes(tmp_path)


def test_times_of_several_machines_are_told_apart(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0), machine={"processor": "abacus", "device": "cpu"})
    assert "\nMachines: abacus (cpu)." in notes(tmp_path)
    write((24.0, 0.9, 60.0), method="humannerf", machine={"processor": "slate", "device": "cpu"})
    said = "**Times of several machines.** Machines: abacus (cpu), slate (cpu)."
    assert said in notes(tmp_path)


def test_every_size_of_a_partial_evaluation_is_told(write: "WriteResult", tmp_path: Path) -> None:
    write((25.0, 0.9, 50.0))
    assert "Only part" not in notes(tmp_path)
    write((24.0, 0.9, 60.0), actor="zoe", limited=True, frames=(3,), cameras=("c1", "c2"))
    assert "Only part of the protocol was evaluated: 1 frames x 2 cameras." in notes(tmp_path)


def test_collapses_are_remembered(tmp_path: Path) -> None:
    assert collapses(tmp_path) == []
    (tmp_path / "runs" / "eve").mkdir(parents=True)
    (tmp_path / "runs" / "eve" / COLLAPSED).write_text("step 9: the actor has vanished.\n")
    assert collapses(tmp_path) == ["**Not made**: eve: step 9: the actor has vanished."]
