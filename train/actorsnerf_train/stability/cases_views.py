"""Hard cases of support views: blind, too close, empty, full, constant, saturated."""

import copy
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from actorsnerf_datasets.torch_dataset import View
from actorsnerf_model.actor_states import support_cameras
from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.pixel_features import read_features
from actorsnerf_model.states import Located
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.cases_pictures import scene
from actorsnerf_train.stability.hard_poses import named_poses

FIELD = Bounds(1e-9, 1e-3, 0.1)
"""Colour in [0, 1], and the opacity of `STEP`."""
LEARNING = Bounds(1e-9, 1e-3, 0.25)
"""The same with the batch's own statistics."""
BLIND = Bounds(0.0, 0.0, 0.0)
STEP = 0.02
"""Metres over which density becomes opacity."""
POINTS = 300
Change = Callable[[View], View]


def view_cases(subject: Subject) -> list[Case]:
    """The cases; the subject tells only whether the method reads pixels at all."""
    changes: dict[str, Change] = {
        "as they are": lambda view: view,
        "all looking away": _away,
        "all looking past the person": _past,
        "a camera inside the person": _within,
        "a camera on a vertex": _on_vertex,
        "empty masks": lambda view: replace(view, alpha=torch.zeros_like(view.alpha)),
        "full masks": lambda view: replace(view, alpha=torch.ones_like(view.alpha)),
        "constant grey pictures": lambda view: _constant(view, 0.5),
        "black pictures": lambda view: _constant(view, 0.0),
        "saturated white pictures": lambda view: _constant(view, 1.0),
        "a checkerboard of 0 and 1": _checkerboard,
        "all the same view": lambda view: view,
    }
    cases = []
    for name, change in changes.items():
        cases.append(_field(name, change, train=False))
        cases.append(_field(name, change, train=True))
    if subject.state.maps is not None:
        cases += [_blind("behind every camera", _away), _blind("outside every picture", _past)]
    return cases


def _field(name: str, change: Change, train: bool) -> Case:
    """The whole way from pictures to the field, and every parameter's gradient."""

    def answer(subject: Subject) -> Answer:
        method = copy.deepcopy(subject.method).train(train)
        views = tuple(change(view) for view in subject.supports)
        if name == "all the same view":
            views = (views[0],) * len(views)
        state = method.actor_state(views, subject.state.window)
        pose, _ = scene(subject, named_poses()["hands clasped"])
        vertices = subject.supports[0].rest_vertices
        points = vertices[:: max(len(vertices) // POINTS, 1)]
        points = points + points.new_tensor([0.003, -0.002, 0.001])
        located = Located(
            torch.arange(len(points), device=points.device), points, torch.ones_like(points[:, 0])
        )
        values = method.field(state, pose, located)
        opacity = -torch.expm1(-values.density * STEP)
        loss = (values.rgb * values.rgb.new_tensor([1.0, 0.6, 0.3])).sum() + opacity.sum()
        weights = [weight for weight in method.parameters() if weight.requires_grad]
        gradients = torch.autograd.grad(loss, weights, allow_unused=True)
        return Answer(torch.cat([values.rgb, opacity[:, None]], -1).detach(), gradients)

    mode = "training" if train else "evaluation"
    measured = f"colour and opacity of 2 cm against float64, {mode} mode"
    bounds = LEARNING if train else FIELD
    return Case("support views", name, measured, bounds, answer)


def _blind(name: str, change: Change) -> Case:
    """What no camera sees reads zeros, and the gradient knows no NaN."""

    def answer(subject: Subject) -> Answer:
        assert isinstance(subject.state.maps, FeatureMap)
        views = tuple(change(view) for view in subject.supports)
        cameras = support_cameras(views)
        points = torch.stack([view.posed_vertices for view in views]).requires_grad_()
        read = read_features(subject.state.maps, cameras, points)
        return Answer(read.detach(), torch.autograd.grad(read.sum(), (points,)))

    def truth(subject: Subject) -> Answer:
        assert isinstance(subject.state.maps, FeatureMap)
        views, count = subject.supports, len(subject.supports[0].posed_vertices)
        channels = subject.state.maps.table.shape[-1]
        return Answer(subject.like.new_zeros(len(views), count, channels))

    return Case("support views", name, "features that are read", BLIND, answer, truth)


def _away(view: View) -> View:
    turn = view.K.new_tensor([-1.0, 1.0, -1.0, 1.0])
    return replace(view, camera_from_body=turn[:, None] * view.camera_from_body)


def _past(view: View) -> View:
    camera = view.camera_from_body.clone()
    camera[0, 3] += 50
    return replace(view, camera_from_body=camera)


def _within(view: View) -> View:
    return _at(view, view.posed_vertices.mean(0))


def _on_vertex(view: View) -> View:
    return _at(view, view.posed_vertices[0])


def _at(view: View, place: Tensor) -> View:
    """The camera moved to a place in the body frame."""
    camera = view.camera_from_body.clone()
    camera[:3, 3] = -(camera[:3, :3] * place).sum(-1)
    return replace(view, camera_from_body=camera)


def _constant(view: View, value: float) -> View:
    return replace(
        view, image=torch.full_like(view.image, value), alpha=torch.ones_like(view.alpha)
    )


def _checkerboard(view: View) -> View:
    height, width = view.alpha.shape
    count = torch.arange(height, device=view.alpha.device)[:, None]
    count = count + torch.arange(width, device=view.alpha.device)
    board = (count % 2).to(view.image)
    image = board[..., None].expand(height, width, 3).clone()
    return replace(view, image=image, alpha=torch.ones_like(view.alpha))


__all__ = ["view_cases"]
