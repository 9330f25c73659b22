"""Trees that HumanNeRF or ActorsNeRF prepared, read back as sources and marked as converted."""

from pathlib import Path

from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_preprocess.source import Found, OpenOptions, SourceError, SourceSequence, Survey


def is_converted_tree(path: Path) -> bool:
    """Whether a folder has the pickles of a prepared subject, at its top or per camera."""
    return (path / "mesh_infos.pkl").is_file() or (path / "0" / "mesh_infos.pkl").is_file()


def survey_converted(found: Found) -> Survey:
    """What is there of a converted subject."""
    raise SourceError(f"{found.path}: not read yet.")


def open_converted(
    found: Found, options: OpenOptions, model: BodyModel, body_model: str
) -> SourceSequence:
    """A converted subject ready to be prepared."""
    raise SourceError(f"{found.path}: not read yet.")
