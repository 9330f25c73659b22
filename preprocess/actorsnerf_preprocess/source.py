"""A raw download as preparation sees it: the border between raw formats and `prepare`.

A raw format provides three functions: `find_<format>(root)` lists the sequences below a folder,
`survey_<format>(found, options)` says on one screen what is there and what is wrong, and
`open_<format>(found, options)` gives a `SourceSequence`: everything but the pictures, in the
standard SMPL convention and metres, and a `FrameReader` that reads the pictures on demand.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets import types
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.findings import Finding as Finding


class SourceError(UserError):
    """The raw data is missing, unreadable, or not what its format says."""


@dataclass(frozen=True)
class Found:
    """A sequence that lies below a source folder, not yet opened."""

    name: str
    """Name of the sequence; the prepared file is called `<name>.h5`."""
    path: Path
    variant: str
    """Which of the data set's directory trees, one line."""
    dataset: Literal["zju-mocap", "aist++", "synthetic", "converted"]


@dataclass(frozen=True)
class OpenOptions:
    """What a user decides about reading a source."""

    body_model: Path | None = None
    """SMPL-format file; None means the packaged free body for synthetic trees, else an error."""
    pairs: Literal["protocol", "all"] = "protocol"
    """Which (camera, frame) pairs: those that a protocol uses, or all."""
    held_out: tuple[str, ...] = ()
    """Names of actors outside the official lists that are held out; the rest are pre-training."""
    masks: Path | None = None
    """A folder of the user's own masks, preferred over those of the source."""
    segmenter: Path | None = None
    """The user's own network, for videos without given masks."""
    ignored: Literal["refuse", "accept"] = "refuse"
    """What to do with sequences on the data set's own ignore list."""


@dataclass(frozen=True)
class Survey:
    """What is there and what is wrong, for one screen."""

    found: Found
    facts: tuple[tuple[str, str], ...]
    """(label, value) lines, in the order of printing."""
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class SourceCamera:
    """One static camera of the source: OpenCV axes, metres, source pixels."""

    name: str
    source_index: int
    K: types.Float64
    """(3, 3); belongs to pictures of `size`."""
    distortion: types.Float64
    """(5,) k1 k2 p1 p2 k3; pictures of the source are distorted by it (zero: they are not)."""
    R: types.Float64
    """(3, 3) camera from world."""
    T: types.Float64
    """(3,) metres."""
    size: tuple[int, int]
    """Width, height of the source pictures."""


@dataclass(frozen=True)
class RawPicture:
    """One picture as the source has it, still distorted."""

    image: types.UInt8
    """(H, W, 3) RGB."""
    mask: types.UInt8 | None
    """(H, W) the person's share, 0 to 255; None: the source has no mask of this picture."""


@dataclass(frozen=True)
class Absent:
    """A picture that should exist and cannot be read."""

    where: str
    """The file."""
    reason: str
    """`missing`, `truncated`, `size 640 x 480 instead of 1024 x 1024`, …"""


@dataclass(frozen=True)
class MaskProbe:
    """What the cheap first pass learns about one picture without decoding its image."""

    mask: types.UInt8 | None
    """(H, W) 0 to 255; None: no mask, or masks of this source are made and cost too much here."""
    digest: str
    """Hex SHA-256 over the bytes of the picture's files; empty if the source is one video."""


@runtime_checkable
class FrameReader(Protocol):
    """Reads pictures on demand. Picklable; opens files lazily in the process that reads.

    Indices are positions in `SourceSequence.cameras` and `SourceSequence.frames`.
    """

    @property
    def frames_per_task(self) -> int:
        """How many frames of one camera a worker should take at once (many for videos)."""

    def files(self, camera_index: int, frame_index: int) -> tuple[Path, ...]:
        """The files this picture comes from, existing or not; the image first."""

    def probe(self, camera_index: int, frame_index: int) -> MaskProbe | Absent:
        """The mask alone, for finding the crop before any image is decoded."""

    def read_many(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        """One item per frame index (ascending), in order."""


@runtime_checkable
class SplitReader(FrameReader, Protocol):
    """A reader whose masks are files of their own, so that they need to be decoded only once."""

    def read_images(
        self, camera_index: int, frame_indices: Sequence[int]
    ) -> Iterator[RawPicture | Absent]:
        """As `read_many` without masks, for pictures whose mask `probe` gave."""


@runtime_checkable
class StageReader(FrameReader, Protocol):
    """A reader that makes masks from each camera's empty stage, which processes can share."""

    def needs_stage(self, camera_index: int) -> bool:
        """Whether masks of this camera are made."""

    def save_stage(self, camera_index: int, path: Path) -> None:
        """Estimates a camera's stage and leaves it at `path`; nothing if no picture is readable.

        Raises:
            SourceError: the disk refuses.
        """

    def load_stage(self, camera_index: int, path: Path) -> None:
        """Takes what `save_stage` left in place of estimating it; nothing if it has it already."""


@dataclass(frozen=True)
class SourceSequence:
    """All of a sequence but its pictures, and how to read those."""

    found: Found
    actor: str
    world_up: types.Float64
    """(3,) unit vector."""
    cameras: tuple[SourceCamera, ...]
    frames: types.Int64
    """(F,) frame numbers, ascending; all have a usable fit."""
    fits: types.BodyFits
    shape: types.ActorShape
    protocols: tuple[types.Protocol, ...]
    wanted: NDArray[np.bool_]
    """(C, F): pairs to prepare."""
    body_model: str
    """Name for the provenance, e.g. `smpl neutral`."""
    mask_source: str
    source_terms: str
    notes: tuple[str, ...]
    """Every decision taken while reading, one sentence each."""
    source_digests: tuple[tuple[str, str], ...]
    """(path inside the source, hex SHA-256) of the files other than pictures."""
    findings: tuple[Finding, ...]
    reader: FrameReader
    published_background: Literal["black", "white"] = "black"
    """Of the data set's published experiments; stored pictures composite exactly on it."""
