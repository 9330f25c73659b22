"""Prepared files that were damaged, edited or mistaken: what `check` and `describe` say.

What these tests record goes into `benchmarks/results/faults.md`; see `scripts/fault_table.py`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest

from actorsnerf_datasets.__main__ import main

Record = Callable[[str, object], None]


@dataclass(frozen=True)
class Fault:
    """One way to be broken and what is said about it."""

    name: str
    sentence: str
    damage: Callable[[Path], object]


def inside(change: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    """A change of the open file."""

    def damage(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            change(file)

    return damage


def put(name: str, place: int, change: Callable[[np.ndarray], object]) -> Callable[[Path], None]:
    """A change of one row of a dataset."""

    def edit(file: h5py.File) -> None:
        file[name][place] = change(file[name][place])

    return inside(edit)


def attribute(name: str, value: object, group: str = "/") -> Callable[[Path], None]:
    """A changed attribute."""

    def edit(file: h5py.File) -> None:
        file[group].attrs[name] = value

    return inside(edit)


def garbage(name: str) -> Callable[[Path], None]:
    """A first chunk that is no zlib stream."""

    def edit(file: h5py.File) -> None:
        file[name].id.write_direct_chunk((0,) * file[name].ndim, b"no zlib stream")

    return inside(edit)


def swapped_cameras(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        for name in ("R", "T"):
            file[f"cameras/{name}"][:2] = file[f"cameras/{name}"][:2][::-1]


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


REFUSED = (
    Fault("prepared file is missing", "does not exist; prepared sequences end in .h5", Path.unlink),
    Fault(
        "prepared file is something else",
        "cannot be opened as HDF5",
        lambda path: path.write_text("hello"),
    ),
    Fault("prepared file is truncated", "cannot be opened as HDF5 .*truncated file", truncated),
    Fault(
        "prepared file of a newer layout",
        "has layout version 2.0, and this release reads 1.0: install the release",
        attribute("layout_version", "2.0"),
    ),
    Fault(
        "HDF5 file of another program",
        "its format is None, expected 'actorsnerf-sequence'",
        inside(lambda file: file.attrs.pop("format")),
    ),
)

FOUND = (
    Fault(
        "an entry is missing",
        "error: fits/transl: is missing",
        inside(lambda file: file.pop("fits/transl")),
    ),
    Fault(
        "an attribute is missing",
        "error: actor: the attribute is missing",
        inside(lambda file: file.attrs.pop("actor")),
    ),
    Fault(
        "an attribute is no JSON",
        "error: header: .*notes.* is no JSON list",
        attribute("notes", "{[oops"),
    ),
    Fault(
        "an unknown role",
        "error: header: .*has the role 'spectator', expected one of pretraining, held_out",
        attribute("role", "spectator", "protocols/generic"),
    ),
    Fault(
        "NaN in the fits",
        r"error: fits/body_pose: has NaN or infinity in frames 103",
        put("fits/body_pose", 3, lambda pose: pose * np.nan),
    ),
    Fault("left-handed camera", "error: cameras/R", put("cameras/R", 1, lambda R: -R)),
    Fault(
        "camera in millimetres",
        "error: cameras/T: camera c02 is .* m from the person",
        put("cameras/T", 1, lambda T: 1000 * T),
    ),
    Fault(
        "two cameras swapped",
        r"pictures/alpha: camera c01: \d+% of the projected vertices are inside the mask",
        swapped_cameras,
    ),
    Fault(
        "joints that do not follow from the pose",
        "error: fits/posed_joints: up to 0.1 m from what the pose gives",
        put("fits/posed_joints", 2, lambda joints: joints + 0.1),
    ),
    Fault(
        "vertices in the world frame",
        "error: fits/posed_vertices: in frame 100 .* outside the vertices: are they in the world",
        put("fits/posed_vertices", 0, lambda vertices: vertices + 3),
    ),
    Fault(
        "an edited number",
        "error: fits/betas: its content is not what its digest says: damaged or edited",
        put("fits/betas", 0, lambda betas: betas + 1e-9),
    ),
    Fault(
        "a damaged picture",
        "error: pictures/rgb: cannot be decoded .*: is the file damaged",
        garbage("pictures/rgb"),
    ),
    Fault(
        "a damaged mask",
        "error: pictures/alpha: cannot be decoded .*: is the file damaged",
        garbage("pictures/alpha"),
    ),
    Fault(
        "damaged vertices",
        "error: fits/posed_vertices.* cannot be decoded",
        garbage("fits/posed_vertices"),
    ),
    Fault(
        "an empty mask that counts as valid",
        "error: pictures/alpha: camera c01: empty masks, but marked valid: in frames 100",
        put("pictures/alpha", 0, lambda alpha: 0 * alpha),
    ),
    Fault(
        "a picture that is not there",
        "error: pictures/valid: 1 pairs are valid but have no picture",
        put("pictures/row", 0, lambda row: np.where(np.arange(len(row)) == 4, -1, row)),
    ),
    Fault(
        "frames out of order",
        "error: frames/number: frame numbers are not strictly ascending",
        put("frames/number", 3, lambda number: number + 5),
    ),
    Fault(
        "a protocol with a camera that is not there",
        "error: protocols/generic: names cameras that are not there: c09",
        attribute("training_camera", "c09", "protocols/generic"),
    ),
)


def named(fault: Fault) -> str:
    return fault.name.replace(" ", "-")


@pytest.mark.parametrize("fault", REFUSED, ids=named)
def test_refused(
    fault: Fault,
    sequence_path: Path,
    capsys: pytest.CaptureFixture[str],
    record_property: Record,
) -> None:
    fault.damage(sequence_path)
    for command in ("check", "describe"):
        assert main([command, str(sequence_path)]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        (line,) = captured.err.splitlines()
        assert re.match(f"error: .*anna.h5: {fault.sentence}", line)
    record_property("fault", fault.name)
    record_property("reads", line.replace(f"{sequence_path.parent}/", ""))
    record_property("outcome", "refused")


@pytest.mark.parametrize("fault", FOUND, ids=named)
def test_found_by_the_check(
    fault: Fault,
    sequence_path: Path,
    capsys: pytest.CaptureFixture[str],
    record_property: Record,
) -> None:
    fault.damage(sequence_path)
    assert main(["check", str(sequence_path)]) == 1
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = captured.out.splitlines()
    line = next((line for line in lines if re.search(fault.sentence, line)), None)
    assert line is not None, captured.out
    record_property("fault", fault.name)
    record_property("reads", line.replace(f"{sequence_path.parent}/", ""))
    record_property("outcome", "found by check (exit 1)")


def test_a_body_model_of_another_person(
    sequence_path: Path,
    body_file: Path,
    capsys: pytest.CaptureFixture[str],
    record_property: Record,
) -> None:
    with np.load(body_file) as arrays:
        content = {**arrays, "v_template": 1.2 * arrays["v_template"]}
    np.savez(body_file, **content)
    assert main(["check", str(sequence_path), "--body-model", str(body_file)]) == 1
    lines = capsys.readouterr().out.splitlines()
    line = next(line for line in lines if "is it the model that the fits were made with" in line)
    record_property("fault", "check with another body model")
    record_property("reads", line.replace(f"{sequence_path.parent}/", ""))
    record_property("outcome", "found by check (exit 1)")
