"""What the command line takes: one class per command, its fields the options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from actorsnerf_preprocess.sources import DatasetName
from actorsnerf_preprocess.zju_layouts import TreeVariant


@dataclass(frozen=True)
class Reading:
    """What is read."""

    source: Path
    """Folder of the download: ZJU-MoCap, AIST++, or a tree of HumanNeRF or ActorsNeRF."""
    dataset: DatasetName | None = None
    """What the source must be, else it is refused; left out: whatever it is found to be.
    `synthetic` draws its actors first if the source is not there."""
    body_model: Path | None = None
    """SMPL-format file (.pkl or .npz); synthetic sources need none."""
    sequences: tuple[str, ...] = ()
    """Only these sequences; all by default. `actorsnerf-30` names the paper's AIST++ sequences."""
    masks: Path | None = None
    """A folder of your own masks, preferred over those of the source: pictures with the person's
    share as grey levels (0 and 1, or 0 to 255; 16 bits too) or as alpha channel, soft edges kept;
    in coloured ones without alpha, not zero is the person. ZJU-MoCap: named as the pictures, but
    .png or .jpg; AIST++: `<video or camera>/<frame>.png`, or one video per camera."""
    segmenter: Path | None = None
    """Your own network (.onnx or TorchScript) that makes the masks of AIST++'s videos where none
    are given: 1x3xHxW RGB in [0, 1] to 1x1xHxW shares in [0, 1]. Left out: made without one."""
    held_out: tuple[str, ...] = ()
    """Actors that are held out for testing, by generic lists where none are published; also one per
    line in <source>/held_out.txt. The others are for pre-training; the test actors of the published
    lists are held out unasked."""
    all_pairs: bool = False
    """Every picture of every camera, not only those that the protocol uses. Of AIST++ that is 60
    pictures per second in place of the protocol's 15."""
    accept_ignored: bool = False
    """Also sequences that the data set's own ignore list names."""


@dataclass(frozen=True)
class Inspect(Reading):
    """Says what a source folder holds and what is wrong with it; writes nothing."""


@dataclass(frozen=True)
class Prepare(Reading):
    """Turns raw sequences into one HDF5 file each: undistorted, resized, cut to the person."""

    out: Path = field(default=Path("prepared"))
    """Folder for the prepared files."""
    scale: float = 0.5
    """Stored size / source size."""
    keep_background: bool = False
    """Keep what is not the person."""
    workers: int = 2
    """Processes."""
    scheduler: str | None = None
    """Address of a dask.distributed scheduler that runs the work in place of own processes."""
    list_needed: bool = False
    """Only list the files that the protocol needs, and which are missing."""
    dry_run: bool = False
    """Only estimate time and disk."""


@dataclass(frozen=True)
class Synthetic:
    """Writes a raw data set of invented dancers, to be prepared like a download.

    Interrupted, the same command goes on.
    """

    out: Path
    """Folder for the raw tree."""
    format: Literal["zju-mocap", "aist"] = "zju-mocap"
    """The data set whose raw tree is written: pictures with masks, or videos without."""
    preset: Literal["tiny", "study", "evaluation"] = "study"
    """How large: for a demonstration, to see learning, or with the paper's 300 + 250 frames."""
    actors: int | None = None
    """Pre-training actors; this and the following numbers replace the preset's."""
    held_out: int | None = None
    """Actors that pre-training must not see."""
    frames: int | None = None
    """Per actor; AIST++'s are 60 per second, of which preparation takes every fourth if there are
    240 or more."""
    cameras: int | None = None
    """Per actor; at most 23 for ZJU-MoCap, 9 for AIST++."""
    size: int | None = None
    """Height of the raw pictures, pixels."""
    zoom: float = 1.0
    """Focal length, times that of the data set's cameras: 1.5 lets ZJU-MoCap's person cover a tenth
    of the picture instead of a twentieth."""
    seed: int = 0
    """Another seed, other people and dances."""
    full: bool = False
    """Draw every camera of every frame, not only what the protocol uses."""
    variant: TreeVariant = "classic-23"
    """Which of ZJU-MoCap's trees: as released (`Camera_B1/000000.jpg` from 0, or time stamps in the
    names, from 1), with names shortened by Neural Human Performer's script, recalibrated
    (`my_<actor>`), made with EasyMocap, or already prepared by HumanNeRF (first camera only) or
    ActorsNeRF. The same seed gives the same pictures in each."""
    fit_noise: bool = False
    """Body fits are off by about 2 degrees and 1 cm."""
    ragged_masks: bool = False
    """Masks have bites and bumps."""


Command = (
    Annotated[Prepare, tyro.conf.subcommand("prepare")]
    | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    | Annotated[Synthetic, tyro.conf.subcommand("synthetic")]
)
"""Any of them."""
