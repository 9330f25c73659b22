"""Frozen dataclasses as JSON objects and back; a wrong key or type is one clear sentence."""

import dataclasses
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.result import Json

Record = TypeVar("Record")


class RecordError(UserError):
    """A JSON object does not hold what the program expects."""


def to_json(value: object) -> Json:
    """A dataclass, tuple, path or plain value as what `json.dumps` takes.

    >>> to_json((1, Path("a/b"), None))
    [1, 'a/b', None]
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_json(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple | list):
        return [to_json(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"{type(value).__name__} has no JSON form")


def to_json_object(value: object) -> dict[str, Json]:
    """A dataclass as a JSON object."""
    record = to_json(value)
    assert isinstance(record, dict)
    return record


def from_json(kind: type[Record], value: Json | Mapping[str, Json], where: str) -> Record:
    """The dataclass that a JSON object describes; no key may be left over.

    A key that is missing takes its default: it came after the file was written, and its default is
    what the program did then. Without a default it is an error.

    Args:
        kind: the dataclass.
        value: from `to_json`.
        where: named in errors, e.g. the file.

    Raises:
        RecordError: a key or a type is wrong.
    """
    return typing.cast(Record, _restored(kind, typing.cast(Json, value), where))


def _restored(kind: Any, value: Json, where: str) -> object:
    origin = typing.get_origin(kind)
    if dataclasses.is_dataclass(kind):
        return _restored_dataclass(typing.cast(type, kind), value, where)
    if origin in (typing.Union, types.UnionType):
        return _restored_union(typing.get_args(kind), value, where)
    if origin is typing.Literal:
        if value in typing.get_args(kind):
            return value
        raise RecordError(f"{where} is {value!r}, expected one of {typing.get_args(kind)}")
    if origin is tuple:
        return _restored_tuple(typing.get_args(kind), value, where)
    return _restored_plain(kind, value, where)


def _restored_plain(kind: Any, value: Json, where: str) -> object:
    if kind is type(None) and value is None:
        return None
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind is Path and isinstance(value, str):
        return Path(value)
    if kind in (bool, int, str) and type(value) is kind:
        return value
    if typing.get_origin(kind) is not None and isinstance(value, dict):  # Mapping[str, Json]
        return value
    raise RecordError(f"{where} is {value!r}, expected {getattr(kind, '__name__', kind)}")


def _restored_dataclass(kind: type, value: Json, where: str) -> object:
    if not isinstance(value, dict):
        raise RecordError(f"{where} is {value!r}, expected an object ({kind.__name__})")
    hints = typing.get_type_hints(kind)
    names = {f.name for f in dataclasses.fields(kind)}
    needed = {f.name for f in dataclasses.fields(kind) if not _has_default(f)}
    unknown, missing = sorted(set(value) - names), sorted(needed - set(value))
    if unknown or missing:
        parts = [f"has no {', '.join(missing)}"] if missing else []
        parts += [f"has an unknown {', '.join(unknown)}"] if unknown else []
        raise RecordError(f"{where} {' and '.join(parts)}: written by another version?")
    known = names & set(value)
    return kind(**{name: _restored(hints[name], value[name], f"{where}/{name}") for name in known})


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _restored_union(kinds: tuple[Any, ...], value: Json, where: str) -> object:
    problem = None
    for kind in kinds:
        try:
            return _restored(kind, value, where)
        except RecordError as error:
            if kind is not type(None):
                problem = error
    raise problem or RecordError(f"{where} is {value!r}")


def _restored_tuple(kinds: tuple[Any, ...], value: Json, where: str) -> tuple[object, ...]:
    if not isinstance(value, list):
        raise RecordError(f"{where} is {value!r}, expected a list")
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(value)
    if len(kinds) != len(value):
        raise RecordError(f"{where} has {len(value)} entries, expected {len(kinds)}")
    return tuple(
        _restored(kind, item, f"{where}[{i}]")
        for i, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )
