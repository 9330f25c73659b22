"""Prepared sequences: the HDF5 layout, its reader, writer, check, and the SMPL arithmetic.

Needs numpy and h5py only; `torch_dataset`, the loader for training, needs torch as well and is
imported by its own name. The layout is specified in the README beside this package.
"""

from actorsnerf_datasets.body_model import BodyModel, PosedBody, load_body_model
from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.errors import BodyModelError, LayoutError, UserError
from actorsnerf_datasets.findings import Finding
from actorsnerf_datasets.layout import LAYOUT_VERSION
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import (
    ActorShape,
    BodyFits,
    Camera,
    Picture,
    Protocol,
    Provenance,
    SequenceHeader,
    Shots,
)
from actorsnerf_datasets.writer import StoredPicture, encode_picture, write_sequence

__all__ = [
    "LAYOUT_VERSION",
    "ActorShape",
    "BodyFits",
    "BodyModel",
    "BodyModelError",
    "Camera",
    "Finding",
    "LayoutError",
    "Picture",
    "PosedBody",
    "Protocol",
    "Provenance",
    "SequenceFile",
    "SequenceHeader",
    "Shots",
    "StoredPicture",
    "UserError",
    "check_sequence",
    "encode_picture",
    "load_body_model",
    "write_sequence",
]
