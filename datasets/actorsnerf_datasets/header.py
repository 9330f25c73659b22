"""A sequence's header as datasets and attributes of a file, both ways."""

import json
from collections.abc import Sequence
from dataclasses import fields
from importlib import metadata
from pathlib import Path
from typing import cast, get_args

import h5py
import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.layout import (
    FORMAT,
    LAYOUT_VERSION,
    PROTOCOL_ATTRIBUTES,
    PROTOCOL_DATASETS,
    ROOT_ATTRIBUTES,
)
from actorsnerf_datasets.shapes import Form, misfits
from actorsnerf_datasets.shell import quoted
from actorsnerf_datasets.types import (
    ActorShape,
    BodyFits,
    Camera,
    Float64,
    ListName,
    Protocol,
    Provenance,
    Role,
    SequenceHeader,
    Shots,
)

Values = NDArray[np.generic] | Sequence[str]
"""What a dataset holds: an array, or strings."""


def header_arrays(header: SequenceHeader) -> dict[str, Values]:
    """Every required dataset but the pictures, by name; strings as lists.

    Raises:
        LayoutError: two cameras have entries of different shapes.
    """
    cameras, digests = header.cameras, header.provenance.source_digests
    fits, shape = header.fits, header.shape
    return {
        "cameras/name": [camera.name for camera in cameras],
        "cameras/source_index": np.array([camera.source_index for camera in cameras], np.int32),
        "cameras/K": _stacked([camera.K for camera in cameras]),
        "cameras/R": _stacked([camera.R for camera in cameras]),
        "cameras/T": _stacked([camera.T for camera in cameras]),
        "cameras/size": np.array([camera.size for camera in cameras], np.int32),
        "cameras/source_K": _stacked([camera.source_K for camera in cameras]),
        "cameras/source_distortion": _stacked([c.source_distortion for c in cameras]),
        "cameras/source_size": np.array([camera.source_size for camera in cameras], np.int32),
        "frames/number": header.frames,
        "fits/global_orient": fits.global_orient,
        "fits/transl": fits.transl,
        "fits/body_pose": fits.body_pose,
        "fits/betas": fits.betas,
        "fits/world_from_body": fits.world_from_body,
        "fits/rest_joints": fits.rest_joints,
        "fits/posed_joints": fits.posed_joints,
        "fits/posed_vertices": fits.posed_vertices,
        "actor/betas": shape.betas,
        "actor/rest_joints": shape.rest_joints,
        "actor/rest_vertices": shape.rest_vertices,
        "provenance/source_path": [name for name, _ in digests],
        "provenance/source_sha256": [digest for _, digest in digests],
    }


def header_attributes(header: SequenceHeader) -> dict[str, str | float | Float64]:
    """The attributes of the file's root, by name."""
    provenance = header.provenance
    return {
        "format": FORMAT,
        "layout_version": LAYOUT_VERSION,
        "dataset": provenance.dataset,
        "variant": provenance.variant,
        "sequence": header.sequence,
        "actor": header.actor,
        "units": "metre",
        "angle_unit": "radian",
        "camera_convention": "opencv camera_from_world",
        "pixel_convention": "centre of the top-left pixel is (0, 0)",
        "smpl_convention": "v = R (x - j0) + j0 + transl",
        "world_up": header.world_up,
        "body_model": provenance.body_model,
        "scale": provenance.scale,
        "background": provenance.background,
        "mask_source": provenance.mask_source,
        "tool_version": f"actorsnerf {_version()}",
        "source_terms": provenance.source_terms,
        "notes": json.dumps(list(provenance.notes), ensure_ascii=False),
    }


def forms(file: h5py.File) -> dict[str, Form]:
    """Shape and dtype of every dataset in an open file, by name."""
    found: dict[str, Form] = {}

    def collect(name: str, node: h5py.Dataset | h5py.Group) -> None:
        if isinstance(node, h5py.Dataset):
            text = h5py.check_string_dtype(node.dtype) is not None
            found[name] = Form(tuple(node.shape), "str" if text else str(node.dtype))

    file.visititems(collect)
    return found


def read_header(file: h5py.File, path: Path, posed_vertices: bool = True) -> SequenceHeader:
    """All of an open sequence but its pictures.

    Args:
        file: open, from `open_sequence`.
        path: for messages.
        posed_vertices: with those of all frames (45 MB in a ZJU-MoCap sequence), or with none.

    Raises:
        LayoutError: an entry is missing, damaged, or of another shape or dtype than the layout's.
    """
    for misfit in misfits(forms(file)):
        raise LayoutError(
            f"{path}: {misfit.entry} {misfit.sentence}: was the file edited or damaged? "
            f"Run: python -m actorsnerf_datasets check {quoted(path)}"
        )
    for name in ROOT_ATTRIBUTES:
        if name not in file.attrs:
            raise LayoutError(f"{path}: attribute {name!r} is missing: was the file edited?")
    try:
        return _header(file, path, posed_vertices)
    except (OSError, RuntimeError) as error:
        raise LayoutError(
            f"{path}: an entry of cameras, frames, fits, actor or protocols cannot be decoded "
            f"({error}): is the file damaged? "
            f"Run: python -m actorsnerf_datasets check {quoted(path)}"
        ) from error


def _header(file: h5py.File, path: Path, posed_vertices: bool) -> SequenceHeader:
    return SequenceHeader(
        sequence=str(file.attrs["sequence"]),
        actor=str(file.attrs["actor"]),
        world_up=np.asarray(file.attrs["world_up"]),
        cameras=_cameras(file),
        frames=np.asarray(file["frames/number"][:]),
        fits=_fits(file["fits"], posed_vertices),
        shape=ActorShape(
            **{field.name: file["actor"][field.name][:] for field in fields(ActorShape)}
        ),
        protocols=_protocols(file, path),
        provenance=_provenance(file, path),
    )


def _stacked(arrays: list[NDArray[np.float64]]) -> Float64:
    if len({array.shape for array in arrays}) > 1:
        raise LayoutError(f"cameras have entries of different shapes: {[a.shape for a in arrays]}")
    return np.array(arrays)


def _version() -> str:
    try:
        return metadata.version("actorsnerf")
    except metadata.PackageNotFoundError:
        return "(not installed)"


def _cameras(file: h5py.File) -> tuple[Camera, ...]:
    group = {name: node[:] for name, node in file["cameras"].items() if name != "name"}
    names = file["cameras/name"].asstr()[:]
    return tuple(
        Camera(
            name=str(name),
            source_index=int(group["source_index"][index]),
            K=group["K"][index],
            R=group["R"][index],
            T=group["T"][index],
            size=_pair(group["size"][index]),
            source_K=group["source_K"][index],
            source_distortion=group["source_distortion"][index],
            source_size=_pair(group["source_size"][index]),
        )
        for index, name in enumerate(names)
    )


def _fits(group: h5py.Group, posed_vertices: bool) -> BodyFits:
    counts = {"posed_vertices": None if posed_vertices else 0}
    names = [field.name for field in fields(BodyFits)]
    return BodyFits(**{name: group[name][: counts.get(name)] for name in names})


def _pair(numbers: NDArray[np.int32]) -> tuple[int, int]:
    return int(numbers[0]), int(numbers[1])


def _protocols(file: h5py.File, path: Path) -> tuple[Protocol, ...]:
    groups = file["protocols"].items() if "protocols" in file else ()
    return tuple(_protocol(name, group, path) for name, group in groups)


def _protocol(name: str, group: h5py.Group, path: Path) -> Protocol:
    missing = [key for key in PROTOCOL_ATTRIBUTES if key not in group.attrs]
    missing += [key for key in PROTOCOL_DATASETS if key not in group]
    if missing:
        raise LayoutError(f"{path}: protocols/{name} has no {', '.join(missing)}")
    role = str(group.attrs["role"])
    if role not in get_args(Role):
        raise LayoutError(
            f"{path}: protocols/{name} has the role {role!r}, expected one of "
            f"{', '.join(get_args(Role))}"
        )
    shots = [
        Shots(
            name=shots_name,
            list_name=cast(ListName, list_name),
            frames=_frame_numbers(lists["frames"]),
            support=_frame_numbers(lists["support"]),
        )
        for shots_name, by_list in (group["shots"].items() if "shots" in group else ())
        for list_name, lists in by_list.items()
    ]
    return Protocol(
        name=name,
        role=cast(Role, role),
        training_camera=str(group.attrs["training_camera"]),
        evaluation_cameras=tuple(str(camera) for camera in group["evaluation_cameras"].asstr()[:]),
        pretraining_frames=_frame_numbers(group["pretraining_frames"]),
        evaluation_frames=_frame_numbers(group["evaluation_frames"]),
        shots=tuple(sorted(shots, key=_shots_order)),
    )


def _shots_order(shots: Shots) -> tuple[str, int, bool]:
    kind, _, count = shots.name.partition("-")
    return kind, int(count) if count.isdigit() else 0, shots.list_name == "auto"


def _frame_numbers(dataset: h5py.Dataset) -> tuple[int, ...]:
    return tuple(int(number) for number in dataset[:])


def _provenance(file: h5py.File, path: Path) -> Provenance:
    attributes = file.attrs
    paths, digests = (file[f"provenance/source_{key}"].asstr()[:] for key in ("path", "sha256"))
    return Provenance(
        dataset=attributes["dataset"],
        variant=str(attributes["variant"]),
        body_model=str(attributes["body_model"]),
        scale=float(attributes["scale"]),
        background=attributes["background"],
        mask_source=str(attributes["mask_source"]),
        source_terms=str(attributes["source_terms"]),
        notes=_notes(str(attributes["notes"]), path),
        source_digests=tuple((str(a), str(b)) for a, b in zip(paths, digests, strict=True)),
    )


def _notes(text: str, path: Path) -> tuple[str, ...]:
    try:
        listed = json.loads(text)
    except ValueError:
        listed = None
    if not isinstance(listed, list):
        raise LayoutError(f"{path}: attribute 'notes' is no JSON list: was the file edited?")
    return tuple(str(note) for note in listed)
