"""Whether a prepared file is what a run would write: digests of all that decides its bytes."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from actorsnerf_preprocess.pictures import PictureOptions
from actorsnerf_preprocess.source import SourceSequence

PREPARATION = 1
"""Of what a preparation makes of the same input: raised by every change of its files' content."""


def settings_digest(source: SourceSequence, options: PictureOptions) -> str:
    """Hex SHA-256 over `PREPARATION`, the options, everything read so far, and the picture files.

    Picture files are not read: a changed picture is noticed by its size or its modification time.
    """
    digest = hashlib.sha256(f"preparation {PREPARATION}".encode())
    digest.update(json.dumps(asdict(options), sort_keys=True).encode())
    for array in (source.frames, source.wanted, *vars(source.fits).values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    described = (
        source.found.name,
        source.actor,
        source.cameras,
        source.protocols,
        source.notes,
        source.source_digests,
        source.mask_source,
        source.body_model,
    )
    digest.update(repr(described).encode())
    for camera, frame in np.argwhere(source.wanted):
        for path in source.reader.files(int(camera), int(frame)):
            digest.update(_state(path).encode())
    return digest.hexdigest()


def pictures_digest(digests: Iterable[str]) -> str:
    """One hex SHA-256 over those of all pictures in order; empty if the pictures have none."""
    listed = [digest for digest in digests if digest]
    return hashlib.sha256("\n".join(listed).encode()).hexdigest() if listed else ""


def _state(path: Path) -> str:
    try:
        status = path.stat()
    except OSError:
        return f"{path.name}: missing"
    return f"{path.name}: {status.st_size} {status.st_mtime_ns}"
