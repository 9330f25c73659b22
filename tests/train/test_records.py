from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import pytest

from actorsnerf_train.config import TrainConfig, fewshot, pretraining
from actorsnerf_train.records import RecordError, from_json, to_json
from actorsnerf_train.result import Json


@dataclass(frozen=True)
class Inner:
    size: int
    share: float


@dataclass(frozen=True)
class Outer:
    name: str
    kind: Literal["a", "b"]
    inner: Inner | None
    many: tuple[Inner, ...]
    pair: tuple[int, str]
    path: Path | None
    on: bool


OUTER = Outer("x", "b", Inner(1, 0.5), (Inner(2, 1.0), Inner(3, 2.0)), (4, "y"), Path("p/q"), True)


def test_there_and_back() -> None:
    record = to_json(OUTER)
    assert record == {
        "name": "x",
        "kind": "b",
        "inner": {"size": 1, "share": 0.5},
        "many": [{"size": 2, "share": 1.0}, {"size": 3, "share": 2.0}],
        "pair": [4, "y"],
        "path": "p/q",
        "on": True,
    }
    assert from_json(Outer, record, "file") == OUTER


@pytest.mark.parametrize("preset", ["official", "official-short", "small", "small-vgg", "tiny"])
def test_every_configuration_survives(preset: str) -> None:
    for config in (pretraining(preset), fewshot(preset)):  # type: ignore[arg-type]  # checked above
        assert from_json(TrainConfig, to_json(config), "config") == config


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("kind", "c", r"file/kind is 'c', expected one of \('a', 'b'\)"),
        ("name", 3, "file/name is 3, expected str"),
        ("on", 1, "file/on is 1, expected bool"),
        ("pair", [1], r"file/pair has 1 entries, expected 2"),
        ("many", 5, "file/many is 5, expected a list"),
        ("inner", {"size": 1}, "file/inner has no share: written by another version"),
        ("inner", {"size": 1, "share": 2, "odd": 3}, "file/inner has an unknown odd"),
        ("many", [{"size": 1.5, "share": 0.0}], r"file/many\[0\]/size is 1.5, expected int"),
    ],
)
def test_wrong_entries_are_named(key: str, value: object, sentence: str) -> None:
    record = to_json(OUTER)
    assert isinstance(record, dict)
    wrong = cast(dict[str, Json], record | {key: value})
    with pytest.raises(RecordError, match=sentence):
        from_json(Outer, wrong, "file")


def test_a_field_younger_than_the_file_takes_its_default() -> None:
    config = pretraining("tiny")
    record = to_json(config)
    assert isinstance(record, dict) and isinstance(record["render"], dict)
    older = {k: v for k, v in record["render"].items() if k != "kept"}
    assert from_json(TrainConfig, record | {"render": older}, "file") == config
    with pytest.raises(RecordError, match="file has no preset"):
        from_json(TrainConfig, {k: v for k, v in record.items() if k != "preset"}, "file")


def test_what_json_cannot_hold_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no JSON form"):
        to_json({"a": object()})
