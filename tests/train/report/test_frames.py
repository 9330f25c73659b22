from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.projection import project
from actorsnerf_train.report.frames import Frame, file_of, report_frames, resized
from actorsnerf_train.trained import TrainedActor

if TYPE_CHECKING:
    from tests.train.report.conftest import People


def test_frames_hold_truth_mask_and_box(frames: tuple[Frame, ...]) -> None:
    assert len(frames) == 2
    for frame in frames:
        assert frame.camera.size == (80, 80) and frame.truth.shape == (80, 80, 3)
        assert frame.name.startswith("camera1, frame ")
        assert 0.01 < frame.mask.float().mean() < 0.5
        assert bool(frame.box[frame.mask].all())  # the person is inside its box
        assert float(frame.truth[~frame.mask].max()) <= 0.5
        assert float(frame.pose[0].abs().max()) == 0


def test_another_actors_file_is_refused(
    trained: TrainedActor[ActorsNeRFState], people: "People"
) -> None:
    with SequenceFile(people.ann) as file, pytest.raises(UserError, match="shows actor ann"):
        report_frames(trained, file, 1, 1)


def test_the_file_of_an_actor_is_found_or_missed(people: "People") -> None:
    here = Path("run")
    assert file_of("eve", (people.ann, people.eve), here) == people.eve
    with pytest.raises(UserError, match=r"run: was fitted to eve, but ann.h5 shows ann: give"):
        file_of("eve", (people.ann,), here)


def test_a_larger_picture_keeps_the_person_and_a_zoom_enlarges_it(
    frames: tuple[Frame, ...],
) -> None:
    frame = frames[0]
    points = torch.tensor([[0.0, 0.0, 0.0], [0.1, -0.3, 0.05]])

    def seen(one: Frame) -> torch.Tensor:
        return project(points, one.camera.K, one.camera.camera_from_body).pixels

    before, wide = seen(frame), resized(frame, (160, 120), 1.0)
    assert wide.camera.size == (160, 120)
    assert torch.allclose(seen(wide), before + torch.tensor([40.0, 20.0]), atol=1e-3)
    near = seen(resized(frame, (160, 160), 2.0))
    assert torch.allclose(near[1] - near[0], 2 * (before[1] - before[0]), atol=1e-3)
    assert torch.allclose(near, 2 * (before + 0.5) - 0.5, atol=1e-3)
