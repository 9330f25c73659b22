from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.humannerf import HumanNeRF
from actorsnerf_model.learned_method import LearnedMethod
from actorsnerf_model.neuralbody import NeuralBody
from actorsnerf_model.presets import HUMANNERF_TINY, NEURALBODY_TINY, TINY

Views = Callable[..., tuple[View, ...]]
NAMES = ("actorsnerf", "humannerf", "neuralbody")


def method_named(name: str) -> LearnedMethod[Any, Any, Any]:
    if name == "neuralbody":
        return NeuralBody(replace(NEURALBODY_TINY, vertices=150, frames=(0, 1)))
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


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_networks_compute_in_the_precision_asked_for(
    name: str, dtype: torch.dtype, support_views: Views
) -> None:
    """Whatever precision lies around them; what they give comes back in the geometry's own."""
    method = method_named(name).eval()
    method.network_dtype = dtype
    given: list[torch.dtype] = []
    for module in method.modules():
        if isinstance(module, torch.nn.Linear):
            module.register_forward_hook(lambda _, __, result: given.append(result.dtype))
    views = support_views(4)
    for around in (False, True):
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=around):
            actor = method.actor_state(views[:3], 2.0)
            pose = method.pose_state(actor, views[3].pose, views[3].rest_joints)
            located = method.locate(actor, pose, views[3].posed_vertices, 0.01)
            field = method.field(actor, pose, located)
            assert {field.rgb.dtype, field.density.dtype} == {torch.float32}
        assert set(given) == {dtype}
        given.clear()


@pytest.mark.parametrize("name", NAMES)
def test_a_method_says_what_it_reads_and_where_its_points_lie(
    name: str, support_views: Views
) -> None:
    """Only Neural Body knows sides and frames, and has no space that poses share."""
    method = method_named(name).eval()
    posed = name == "neuralbody"
    assert (method.reads_directions, method.canonical_space) == (posed, not posed)
    views = support_views(4)
    with torch.no_grad():
        actor = method.actor_state(views[:3], 2.0)
        pose = method.pose_state(actor, views[3].pose, views[3].rest_joints, 1)
        located = method.locate(actor, pose, views[3].posed_vertices, 0.01)
    stays = torch.equal(located.canonical, views[3].posed_vertices[located.index])
    assert stays == posed


def test_an_unfinished_method_cannot_be_made() -> None:
    class Half(LearnedMethod[None, None, None]):
        pass

    with pytest.raises(TypeError, match="abstract"):
        Half(torch.float32)  # type: ignore[abstract]
