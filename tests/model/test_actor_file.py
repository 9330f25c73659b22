from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_file import support_tensors, supports_from_tensors

Views = Callable[..., tuple[View, ...]]
CPU = torch.device("cpu")


def bytes_of(view: View) -> View:
    """The view with pictures as a loader makes them: whole 255ths."""
    image, alpha = ((x * 255).round() / 255 for x in (view.image, view.alpha * 0.7))
    return replace(view, image=image, alpha=alpha, actor="Zoë", offset=(-3, 8), frame=301)


def test_views_come_back_exactly(support_views: Views, tmp_path: Path) -> None:
    views = (bytes_of(support_views(1)[0]), *support_views(2))
    save_file(support_tensors(views), tmp_path / "actor.safetensors")
    again = supports_from_tensors(load_file(tmp_path / "actor.safetensors"), CPU)
    assert len(again) == 3
    for view, other in zip(views, again, strict=True):
        for field in fields(View):
            value, back = getattr(view, field.name), getattr(other, field.name)
            if isinstance(value, torch.Tensor):
                assert value.dtype == back.dtype
                assert torch.equal(value, back), field.name
            else:
                assert value == back, field.name


def test_pictures_of_whole_levels_are_stored_as_bytes(support_views: Views) -> None:
    view = support_views(1)[0]
    assert support_tensors((bytes_of(view),))["0.image"].dtype == torch.uint8
    assert support_tensors((view,))["0.image"].dtype == torch.float32


def test_without_views(support_views: Views) -> None:
    with pytest.raises(UserError, match="no support views among the 1 stored tensors"):
        supports_from_tensors({"radiance.weight": torch.zeros(1)}, CPU)


def test_a_missing_field_is_named(support_views: Views) -> None:
    tensors = support_tensors(support_views(1))
    del tensors["0.rest_joints"]
    with pytest.raises(UserError, match="support view 0 is stored without rest_joints"):
        supports_from_tensors(tensors, CPU)
