import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.picture_checks import (
    Index,
    digest_findings,
    index_findings,
    inside_share,
    mask_findings,
    protocol_findings,
    read_index,
)
from actorsnerf_datasets.types import Picture, SequenceHeader


@pytest.fixture
def index(sequence_path: Path) -> Index:
    """The index of a good sequence."""
    with h5py.File(sequence_path) as file:
        return read_index(file)


def _edited(path: Path, edit: Callable[[h5py.File], None]) -> h5py.File:
    with h5py.File(path, "r+") as file:
        edit(file)
    return h5py.File(path)


def test_a_good_sequence_has_no_findings(
    sequence_path: Path, header: SequenceHeader, index: Index
) -> None:
    with h5py.File(sequence_path) as file:
        assert list(digest_findings(file)) == []
        assert list(mask_findings(file, header, index)) == []
    assert list(index_findings(header, index)) == []


def test_digests_notice_a_changed_number(sequence_path: Path) -> None:
    def edit(file: h5py.File) -> None:
        file["fits/betas"][3, 2] += 1e-12
        del file["frames/number"].attrs["sha256"]
        file["pictures/alpha"].id.write_direct_chunk((4, 0, 0), b"damaged")

    with _edited(sequence_path, edit) as file:
        found = {f.entry: f.sentence for f in digest_findings(file)}
    assert found["fits/betas"] == "its content is not what its digest says: damaged or edited?"
    assert found["frames/number"] == "has no attribute 'sha256'"
    assert found["pictures/alpha"].startswith("cannot be decoded (")
    assert len(found) == 3


def test_row_and_valid_contradict_each_other(header: SequenceHeader, index: Index) -> None:
    row, valid = index.row.copy(), index.valid.copy()
    valid[2, 11] = True
    valid[0, 0] = False
    row[1, 1] = row[1, 2]
    reversed_header = dataclasses.replace(header, frames=header.frames[::-1])
    found = index_findings(reversed_header, dataclasses.replace(index, row=row, valid=valid))
    assert [(f.severity, f.sentence) for f in found] == [
        ("error", "frame numbers are not strictly ascending"),
        ("error", "1 pairs are valid but have no picture"),
        ("error", "does not name each of the 35 pictures exactly once"),
        ("note", "1 stored pictures are marked unusable"),
    ]


def test_a_sequence_without_a_valid_picture_is_an_error(
    header: SequenceHeader, index: Index
) -> None:
    none = dataclasses.replace(index, valid=np.zeros_like(index.valid))
    assert [(f.severity, f.sentence) for f in index_findings(header, none)] == [
        (
            "error",
            "none of the 36 pairs of a camera and a frame has a valid picture: prepare the "
            "sequence again and see its report",
        ),
        ("note", "35 stored pictures are marked unusable"),
    ]


def test_protocols_that_ask_for_what_is_not_there(header: SequenceHeader, index: Index) -> None:
    (finding,) = protocol_findings(header, index)
    assert finding.severity == "warning"
    assert finding.sentence.startswith("1 of the 16 pictures it uses are not there")
    protocol = dataclasses.replace(
        header.protocols[0],
        evaluation_cameras=("c02", "c07"),
        evaluation_frames=(107, 500),
    )
    found = protocol_findings(dataclasses.replace(header, protocols=(protocol,)), index)
    assert [(f.severity, f.sentence) for f in found] == [
        ("error", "names cameras that are not there: c07"),
        ("error", "names frames that are not there: 500"),
    ]


def test_empty_full_and_misplaced_masks(
    sequence_path: Path, header: SequenceHeader, index: Index
) -> None:
    def edit(file: h5py.File) -> None:
        alpha, row = file["pictures/alpha"], index.row
        alpha[row[0, 2]] = 0
        alpha[row[0, 5]] = 255
        file["pictures/offset"][row[1, 1]] = [90, 0]
        for frame in range(11):
            alpha[row[2, frame]] = np.roll(alpha[row[2, frame]], 30, axis=1)

    with _edited(sequence_path, edit) as file:
        found = [
            f"{f.severity}: {f.sentence}" for f in mask_findings(file, header, read_index(file))
        ]
    assert found[0] == "error: camera c01: empty masks, but marked valid: in frames 102"
    assert found[1] == "warning: camera c01: masks fill the crop: in frames 105"
    assert found[2] == "error: camera c02: crops that lie outside the picture: in frames 101"
    assert found[3].startswith("error: camera c03: ")
    assert "of the projected vertices are inside the mask (expected 90%)" in found[3]
    assert len(found) == 4


def test_a_small_shift_is_a_warning(
    sequence_path: Path, header: SequenceHeader, index: Index
) -> None:
    def edit(file: h5py.File) -> None:
        file["pictures/offset"][:] += [4, 0]

    with _edited(sequence_path, edit) as file:
        found = list(mask_findings(file, header, read_index(file)))
    assert {f.severity for f in found} == {"warning"}
    assert len(found) == 3


def test_the_share_by_hand(
    header: SequenceHeader, picture_of: Callable[[int, int], Picture]
) -> None:
    picture = picture_of(0, 0)
    assert inside_share(header, (0, 0), picture.alpha, picture.offset) == 1.0
    assert inside_share(header, (0, 0), picture.alpha * 0, picture.offset) == 0.0
    upper = picture.alpha.copy()
    upper[32:] = 0
    assert 0.2 < inside_share(header, (0, 0), upper, picture.offset) < 0.8
    behind = dataclasses.replace(header.cameras[0], T=-header.cameras[0].T)
    turned = dataclasses.replace(header, cameras=(behind,))
    assert np.isnan(inside_share(turned, (0, 0), picture.alpha, picture.offset))
