import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.header import header_arrays, header_attributes, read_header
from actorsnerf_datasets.layout import ENTRIES, ROOT_ATTRIBUTES
from actorsnerf_datasets.types import SequenceHeader


def _assert_same(found: object, expected: object) -> None:
    if dataclasses.is_dataclass(expected):
        for field in dataclasses.fields(expected):
            _assert_same(getattr(found, field.name), getattr(expected, field.name))
    elif isinstance(expected, np.ndarray):
        assert isinstance(found, np.ndarray)
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    elif isinstance(expected, tuple):
        assert isinstance(found, tuple)
        for one, other in zip(found, expected, strict=True):
            _assert_same(one, other)
    else:
        assert found == expected
        assert type(found) is type(expected)


def test_a_header_comes_back_as_it_was(sequence_path: Path, header: SequenceHeader) -> None:
    with h5py.File(sequence_path) as file:
        _assert_same(read_header(file, sequence_path), header)


def test_the_names_are_the_layouts(header: SequenceHeader) -> None:
    names = {entry.path for entry in ENTRIES if not entry.path.startswith("pictures/")}
    assert set(header_arrays(header)) == names
    assert set(header_attributes(header)) == set(ROOT_ATTRIBUTES)


def test_without_sources_and_protocols(header: SequenceHeader, tmp_path: Path) -> None:
    provenance = dataclasses.replace(header.provenance, source_digests=(), notes=())
    bare = dataclasses.replace(header, provenance=provenance, protocols=())
    assert header_arrays(bare)["provenance/source_path"] == []
    assert header_attributes(bare)["notes"] == "[]"


def test_what_is_missing_is_named(sequence_path: Path) -> None:
    with h5py.File(sequence_path, "r+") as file:
        file["protocols/generic"].attrs["role"] = "spectator"
        with pytest.raises(LayoutError, match="the role 'spectator', expected one of pretraining"):
            read_header(file, sequence_path)
        del file["protocols/generic/evaluation_frames"]
        with pytest.raises(LayoutError, match="protocols/generic has no evaluation_frames"):
            read_header(file, sequence_path)
        del file.attrs["actor"]
        with pytest.raises(LayoutError, match="attribute 'actor' is missing"):
            read_header(file, sequence_path)
        del file["fits/transl"]
        with pytest.raises(LayoutError, match="fits/transl is missing: was the file edited"):
            read_header(file, sequence_path)
