from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from actorsnerf_train.report.measure import Effort
from actorsnerf_train.report.memory import MemoryJob, peak_memory
from actorsnerf_train.report.points import named_point

if TYPE_CHECKING:
    from tests.train.report.conftest import People


@pytest.mark.slow
def test_a_frame_takes_some_memory_in_a_process_of_its_own(
    fewshot_run: Path, people: "People"
) -> None:
    effort = Effort(1, 1.0, 0)
    job = MemoryJob(fewshot_run, people.eve, named_point("exact"), 12, effort, 1, "cpu")
    (found,) = peak_memory([job])
    assert found is not None and 0.1 < found < 4000
