import numpy as np
import pytest

from actorsnerf_datasets.protocols import generic_protocol
from actorsnerf_preprocess.held_out import held_out_warning


@pytest.mark.parametrize(
    ("frames", "lists"),
    [(500, "held out, with generic lists: no c01."), (8, "held out, its 8 frames give no few-")],
)
def test_the_warning_says_who_which_lists_and_why(frames: int, lists: str) -> None:
    protocol = generic_protocol("held_out", ["c02", "c03"], np.arange(frames))
    warning = held_out_warning("d16", protocol, "no c01", frames)
    assert (warning.severity, warning.entry) == ("warning", "protocol")
    assert warning.sentence.startswith("d16 is a test actor of the published experiments")
    assert lists in warning.sentence and warning.sentence.endswith(": no c01.")
