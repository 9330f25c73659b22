"""Whether a prepared sequence is what the layout says, and can be right."""

from pathlib import Path

import h5py

from actorsnerf_datasets.body_model import load_body_model
from actorsnerf_datasets.camera_checks import camera_findings
from actorsnerf_datasets.errors import LayoutError
from actorsnerf_datasets.findings import Finding, Severity
from actorsnerf_datasets.fit_checks import body_model_findings, fit_findings
from actorsnerf_datasets.header import forms, read_header
from actorsnerf_datasets.layout import ROOT_ATTRIBUTES
from actorsnerf_datasets.picture_checks import (
    digest_findings,
    index_findings,
    mask_findings,
    protocol_findings,
    read_index,
)
from actorsnerf_datasets.reader import open_sequence
from actorsnerf_datasets.shapes import misfits

__all__ = ["Finding", "Severity", "check_sequence"]


def check_sequence(path: Path, body_model: Path | None = None) -> tuple[Finding, ...]:
    """Everything that is wrong or worth knowing about a prepared sequence; empty if in order.

    Checked are: every entry's presence, dtype and shape; finiteness; rotations; units, by
    plausible camera distances and body heights; posed joints against pose and rest joints; global
    transforms against `global_orient` and `transl`; posed vertices against the body model, if one
    is given; `row` and `valid` against each other; empty and full masks; projected vertices
    against the masks; the protocols' cameras, frames and pictures; and all digests.

    Args:
        path: the file.
        body_model: the SMPL-format file that the fits were made with.

    Raises:
        LayoutError: the file cannot be opened as a prepared sequence of this layout.
        BodyModelError: the body model cannot be read.
    """
    model = None if body_model is None else load_body_model(body_model)
    with open_sequence(path) as file:
        found = _structure(file)
        if found:
            return tuple(found)  # the rest would build on what is not there
        try:
            header = read_header(file, path)
        except LayoutError as error:
            return (Finding("error", "header", str(error)), *digest_findings(file))
        geometry = [*camera_findings(header), *fit_findings(header)]
        index = read_index(file)
        found = [*digest_findings(file), *geometry]
        found += [*index_findings(header, index), *protocol_findings(header, index)]
        if any(finding.severity == "error" for finding in geometry):
            why = "not compared with the body, because of the errors in cameras or fits"
            return (*found, Finding("note", "pictures/alpha", why))
        found += mask_findings(file, header, index)
        if model is not None:
            found += body_model_findings(header, model)
    return tuple(found)


def _structure(file: h5py.File) -> list[Finding]:
    found = [Finding("error", misfit.entry, misfit.sentence) for misfit in misfits(forms(file))]
    missing = [name for name in ROOT_ATTRIBUTES if name not in file.attrs]
    return found + [Finding("error", name, "the attribute is missing") for name in missing]
