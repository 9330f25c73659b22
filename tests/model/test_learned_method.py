from collections.abc import Callable
from typing import Any

import pytest
import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.humannerf import HumanNeRF
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.presets import HUMANNERF_TINY, TINY

Views = Callable[..., tuple[View, ...]]
NAMES = ("actorsnerf", "humannerf")


def method_named(name: str) -> LearnedMethod[Any, Any, Any]:
    return ActorsNeRF(TINY) if name == "actorsnerf" else HumanNeRF(HUMANNERF_TINY)


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_is_in_exactly_one_part(name: str) -> None:
    method = method_named(name)
    inside = [id(p) for part in method.parts().values() for p in part.parameters()]
    assert sorted(inside) == sorted(id(p) for p in method.parameters())


@pytest.mark.parametrize("name", NAMES)
def test_a_state_made_in_stages_is_the_state(name: str, support_views: Views) -> None:
    method = method_named(name).eval()
    views = support_views(4)
    staged = method.instance_state(method.category_prior(views[:3], method.geometry(views[0])), 2.0)
    at_once = method.actor_state(views[:3], 2.0)
    pose = method.pose_state(staged, views[3].pose, views[3].rest_joints)
    located = method.locate(staged, pose, views[3].posed_vertices, 0.01)
    assert located.index.numel() > 10
    with torch.no_grad():
        one = method.field(staged, pose, located)
        other = method.field(at_once, pose, located)
    assert torch.equal(one.rgb, other.rgb)
    assert torch.equal(one.density, other.density)


def test_an_unfinished_method_cannot_be_made() -> None:
    class Half(LearnedMethod[None, None, None]):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Half()  # type: ignore[abstract]
