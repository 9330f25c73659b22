from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.findings import Finding
from actorsnerf_preprocess import source
from actorsnerf_preprocess.image_files import ImageReader
from actorsnerf_preprocess.source import FrameReader, OpenOptions, SourceError


def test_source_errors_are_sentences_for_the_user() -> None:
    assert issubclass(SourceError, UserError)


def test_findings_are_those_of_the_check() -> None:
    assert source.Finding is Finding


def test_image_files_are_a_frame_reader() -> None:
    assert isinstance(ImageReader(Path(), {}, ()), FrameReader)


def test_only_what_a_protocol_needs_is_read_by_default() -> None:
    assert OpenOptions().pairs == "protocol"
    assert OpenOptions().ignored == "refuse"
