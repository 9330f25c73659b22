import dataclasses
from pathlib import Path

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import (
    FewshotChoice,
    camera_index,
    find_protocol,
    find_shots,
    pretraining_protocol,
    usable,
)
from actorsnerf_datasets.types import Protocol, SequenceHeader, Shots


@pytest.fixture
def file(sequence_path: Path) -> SequenceFile:
    return SequenceFile(sequence_path)


def with_protocols(file: SequenceFile, *protocols: Protocol) -> SequenceFile:
    changed = SequenceFile(file.path)
    changed.__dict__["header"] = dataclasses.replace(file.header, protocols=protocols)
    return changed


def test_a_camera_by_name_and_by_position(file: SequenceFile) -> None:
    assert camera_index(file, "c03") == camera_index(file, 2) == 2
    with pytest.raises(UserError, match=r"has no camera at position -1; it has 3\."):
        camera_index(file, -1)


def test_the_only_protocol_needs_no_name(file: SequenceFile) -> None:
    (only,) = file.header.protocols
    assert find_protocol(file, None) == find_protocol(file, only.name) == only
    other = dataclasses.replace(only, name="other")
    two = with_protocols(file, only, other)
    assert find_protocol(two, "other") == other
    with pytest.raises(UserError, match=r"has 2 protocols \(generic, other\): name one"):
        find_protocol(two, None)
    with pytest.raises(UserError, match=r"has 0 protocols \(none\)"):
        find_protocol(with_protocols(file), None)


def test_one_held_out_role_bars_a_file_from_pretraining(file: SequenceFile) -> None:
    (held_out,) = file.header.protocols
    free = dataclasses.replace(held_out, name="free", role="pretraining")
    assert pretraining_protocol(with_protocols(file, free)) == free
    for protocols in ((free, held_out), (held_out, free)):
        with pytest.raises(UserError, match="actor anna is held out for testing in protocol gener"):
            pretraining_protocol(with_protocols(file, *protocols))
    with pytest.raises(UserError, match="has no protocol, so no pre-training frames"):
        pretraining_protocol(with_protocols(file))


def test_the_official_list_comes_first_unless_named(
    file: SequenceFile, header: SequenceHeader
) -> None:
    (protocol,) = header.protocols
    auto = Shots("fewshot-5", "auto", (100, 101, 102, 103, 104), (100, 101, 102))
    official = Shots("fewshot-5", "official", (100, 102, 104, 106, 108), (104, 106, 108))
    both = dataclasses.replace(protocol, shots=(auto, official))
    assert find_shots(file, both, FewshotChoice("fewshot-5")) == official
    assert find_shots(file, both, FewshotChoice("fewshot-5", "auto")) == auto
    one = dataclasses.replace(protocol, shots=(auto,))
    assert find_shots(file, one, FewshotChoice("fewshot-5")) == auto
    fewer = find_shots(file, both, FewshotChoice("fewshot-5", k=1))
    assert fewer == dataclasses.replace(official, support=(104,))


def test_usable_says_why_not(file: SequenceFile) -> None:
    usable(file, 0, (100, 105, 111), "frames")
    with pytest.raises(
        UserError,
        match=r"camera c03 has no valid picture of 1 of the 2 supports, first of frame 111: it is "
        r"not stored: either .* report anna\.json says why, or .* prepare again with --all-pairs\.",
    ):
        usable(file, 2, (105, 111), "supports")
