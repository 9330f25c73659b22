import dataclasses

import pytest

from actorsnerf_datasets.errors import UserError
from actorsnerf_train import result
from actorsnerf_train.result import CameraRow, Evaluation, ImageRow, MeanRow


def with_means(*means: MeanRow) -> Evaluation:
    """An evaluation of which only the means matter."""
    return Evaluation(
        method="actorsnerf",
        preset="tiny",
        actor="eve",
        sequence="eve-walks",
        dataset="synthetic",
        data_sha256="",
        protocol="generic",
        setting=None,
        list_name=None,
        shots=None,
        supports=3,
        frames=(),
        cameras=(),
        limited=False,
        missing=(),
        background=(0.0, 0.0, 0.0),
        encoder=None,
        encoder_pretrained=False,
        pretrained_from=None,
        seed=0,
        step=0,
        training_seconds=0.0,
        configuration={},
        checkpoint="",
        render_options={},
        lpips_note=None,
        machine={},
        commit=None,
        time="",
        seconds=0.0,
        render_seconds=0.0,
        means=means,
        per_camera=(),
        per_image=(),
    )


def test_the_mean_under_a_convention() -> None:
    paper, box = MeanRow("paper", 27.7, 0.95, None), MeanRow("box", 20.0, 0.8, 39.8)
    assert with_means(paper, box).mean("box") == box


def test_a_convention_that_was_not_evaluated_is_a_sentence() -> None:
    one = with_means(MeanRow("paper", 27.7, 0.95, None))
    with pytest.raises(UserError, match="actor eve has no convention 'strict', only paper: evalua"):
        one.mean("strict")


def test_every_field_is_documented() -> None:
    assert result.__doc__ is not None
    for field in dataclasses.fields(Evaluation):
        assert field.name in result.__doc__
    for row in (MeanRow, CameraRow, ImageRow):
        for field in dataclasses.fields(row):
            assert field.name in result.__doc__
