"""Hard cases of whole pictures: the renderer against the reference, in hard poses and views."""

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.rays import Rays, intersect_box, rays_through, sample_depths
from actorsnerf_model.reference import reference_render_pixels
from actorsnerf_model.render import render, render_pixels
from actorsnerf_model.states import Camera, FieldValues, Located, PoseState, Rendering
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.cases_rays import looking
from actorsnerf_train.stability.hard_poses import named_poses

CameraOf = Callable[[Float[Tensor, "2 3"]], Camera]
"""From the bounds of a posed body, float64."""
PICTURE = Bounds(1e-7, 1 / 255, 0.1, gradient=3e-2)
"""Colour in [0, 1]. In float64 the bones that the warp leaves out show (weights below 1e-10, less
than a micrometre): 1e-9 in an untrained field, up to 1e-8 in a trained one, which is steeper.
bfloat16 has 8 bits, and its networks a dozen layers. Gradients: where few samples are seen, one
unit whose ReLU rounding turns is 1.7 % of the layer before it (measured: that layer alone is off,
those behind it agree to 6e-6)."""
WHOLE = replace(PICTURE, gradient=None)
GROUND = Bounds(0.0, 0.0, 0.0)
SIDE = 12
"""Pixels of the pictures of hard poses."""
UNSURE = 1e-4
"""Relative distance from the threshold at which float32 may decide either way: a ray with such a
sample is not compared, because one sample more or less is a difference of the method itself."""
FIELD_DENSITIES = (0.0, 1e3, 1e6)


def picture_cases(subject: Subject) -> list[Case]:
    """The cases; the subject tells only the fastest poses."""
    fast = {f"fastest frame {i + 1}": pose for i, pose in enumerate(subject.poses.double().cpu())}
    poses = {**named_poses(), **fast}
    cases = [_posed(name, pose, 0.7 * i) for i, (name, pose) in enumerate(poses.items())]
    still = named_poses()["splits"]
    cases += [
        _seen("upside-down", still, lambda b: _upside_down(looking(b, 0.4, (SIDE, SIDE), 1.0))),
        _seen("cut by the border", still, lambda b: _shifted(looking(b, 0.4, (SIDE, SIDE), 1.5))),
        _seen(
            "camera inside the box", still, lambda b: _inside(looking(b, 0.4, (SIDE, SIDE), 1.0))
        ),
        _seen("one-pixel person", still, lambda b: looking(b, 0.4, (11, 11), 0.09)),
        _seen("one-pixel picture", still, lambda b: looking(b, 0.4, (1, 1), 1.0)),
        _seen("large picture, small person", still, _large),
    ]
    cases += [_nobody("box behind the camera", _behind), _nobody("person beside the picture", _off)]
    cases += [_dense(density) for density in FIELD_DENSITIES]
    return cases


def scene(subject: Subject, pose: Float[Tensor, "24 3"]) -> tuple[PoseState, Float[Tensor, "24 3"]]:
    """The state of a pose, and the pose at the subject's precision."""
    given = subject.tensor(pose)
    joints = subject.supports[0].canonical_joints
    with torch.no_grad():
        return subject.method.pose_state(subject.state, given, joints), given


def sure_rays(subject: Subject, pose: PoseState, rays: Rays) -> Bool[Tensor, "rays"]:
    """The rays without a sample that rounding could carry over the threshold."""
    options = subject.options
    span = intersect_box(rays, pose.bounds)
    depths = sample_depths(span.near, span.far, options.samples, None)
    points = rays.origin + depths[:, :, None] * rays.directions[:, None]
    unsure = torch.zeros_like(depths, dtype=torch.bool)
    with torch.no_grad():
        for number, part in enumerate(points):
            located = subject.method.locate(subject.state, pose, part, 0.0)
            away = (located.likelihood - options.threshold).abs()
            unsure[number] = away < UNSURE * options.threshold
    return ~unsure.any(-1)


def _posed(name: str, pose: Float[Tensor, "24 3"], angle: float) -> Case:
    def rays_of(subject: Subject, state: PoseState) -> Rays:
        return _grid(_before(subject, state, angle))

    def answer(subject: Subject) -> Answer:
        state, _ = scene(subject, pose)
        seen = render_pixels(
            subject.method, subject.state, state, rays_of(subject, state), subject.options
        )
        weights = list(subject.method.radiance.parameters())
        loss = (seen.rgb * seen.rgb.new_tensor([1.0, 0.6, 0.3])).sum() + seen.alpha.sum()
        gradients: tuple[Tensor | None, ...] = (None,) * len(weights)
        if seen.counts.survivors > 0:
            gradients = torch.autograd.grad(loss, weights, allow_unused=True)
        return Answer(_colours(seen), gradients)

    def truth(subject: Subject) -> Answer:
        state, _ = scene(subject, pose)
        rays = rays_of(subject, state)
        return _reference(subject, state, rays)

    measured = "colour and alpha of 144 rays against the reference"
    return Case("picture", name, measured, PICTURE, answer, truth)


def _seen(name: str, pose: Float[Tensor, "24 3"], camera_of: CameraOf) -> Case:
    """A whole picture by `render`, footprint and all; at most 144 of its pixels are compared."""

    def setting(subject: Subject) -> tuple[PoseState, Camera, Tensor]:
        state, _ = scene(subject, pose)
        camera = _rounded(camera_of(state.bounds.double().cpu()), subject)
        width, height = camera.size
        x = torch.linspace(0, width - 1, min(width, SIDE)).round()
        y = torch.linspace(0, height - 1, min(height, SIDE)).round()
        if max(camera.size) > SIDE:  # the middle, where the person is
            x, y = x * 0 + width // 2 - SIDE // 2, y * 0 + height // 2 - SIDE // 2
            x, y = x + torch.arange(len(x)), y + torch.arange(len(y))
        return state, camera, torch.cartesian_prod(x, y).reshape(-1, 2)

    def answer(subject: Subject) -> Answer:
        state, camera, pixels = setting(subject)
        with torch.no_grad():
            seen = render(subject.method, subject.state, state, camera, subject.options)
        at = pixels.long()
        rgb, alpha = seen.rgb[at[:, 1], at[:, 0]], seen.alpha[at[:, 1], at[:, 0]]
        finite = torch.isfinite(seen.rgb).all() & torch.isfinite(seen.depth).all()
        poison = 0.0 if bool(finite) else float("nan")
        note = f"{seen.counts.rays} rays, {seen.counts.survivors} survivors"
        return Answer(torch.cat([rgb, alpha[:, None]], -1) + poison, note=note)

    def truth(subject: Subject) -> Answer:
        state, camera, pixels = setting(subject)
        return _reference(subject, state, rays_through(pixels.to(camera.K), camera))

    return Case("picture", name, "colour and alpha against the reference", WHOLE, answer, truth)


def _nobody(name: str, camera_of: CameraOf) -> Case:
    def answer(subject: Subject) -> Answer:
        state, _ = scene(subject, named_poses()["T-pose"])
        camera = _rounded(camera_of(state.bounds.double().cpu()), subject)
        with torch.no_grad():
            seen = render(subject.method, subject.state, state, camera, subject.options)
        return Answer(_colours(seen))

    def truth(subject: Subject) -> Answer:
        ground = subject.like.new_tensor([*subject.options.background, 0.0])
        return Answer(ground.expand(SIDE, SIDE, 4))

    return Case("picture", name, "difference from the background", GROUND, answer, truth)


def _dense(density: float) -> Case:
    """The method's own geometry with a field of one density."""

    def setting(subject: Subject) -> tuple["_Fog", PoseState, Rays]:
        state, _ = scene(subject, named_poses()["hands clasped"])
        return _Fog(subject, density), state, _grid(_before(subject, state, 0.4))

    def answer(subject: Subject) -> Answer:
        fog, state, rays = setting(subject)
        seen = render_pixels(fog, subject.state, state, rays, subject.options)
        gradients = torch.autograd.grad(seen.rgb.sum(), (fog.density,), allow_unused=True)
        return Answer(_colours(seen), gradients)

    def truth(subject: Subject) -> Answer:
        fog, state, rays = setting(subject)
        with torch.no_grad():
            seen = reference_render_pixels(fog, subject.state, state, rays, subject.options)
        return Answer(_colours(seen), counted=sure_rays(subject, state, rays))

    measured = "colour and alpha against the reference"
    bounds = replace(PICTURE, bfloat16=1 / 255)
    return Case("picture", f"density {density:g} everywhere", measured, bounds, answer, truth)


class _Fog:
    """A method whose field has one density, and colours by place."""

    reads_directions = False

    def __init__(self, subject: Subject, density: float) -> None:
        self.subject = subject
        self.density = subject.like.new_tensor(density).requires_grad_()

    def actor_state(self, supports: object, window: float) -> object:
        return self.subject.state

    def pose_state(self, actor: object, pose: Tensor, rest_joints: Tensor) -> PoseState:
        return self.subject.method.pose_state(self.subject.state, pose, rest_joints)

    def locate(self, actor: object, pose: PoseState, points: Tensor, threshold: float) -> Located:
        return self.subject.method.locate(self.subject.state, pose, points, threshold)

    def field(self, actor: object, pose: PoseState, located: Located) -> FieldValues:
        rgb = torch.sigmoid(3 * located.canonical)
        return FieldValues(rgb, self.density.expand(rgb.shape[0]))


def _reference(subject: Subject, state: PoseState, rays: Rays) -> Answer:
    with torch.no_grad():
        seen = reference_render_pixels(subject.method, subject.state, state, rays, subject.options)
    sure = sure_rays(subject, state, rays)
    note = f"mean alpha {float(seen.alpha.mean()):.2g}, {int((~sure).sum())} rays not compared"
    return Answer(_colours(seen), counted=sure, note=note)


def _colours(seen: Rendering) -> Tensor:
    return torch.cat([seen.rgb, seen.alpha[..., None]], -1).detach()


def _grid(camera: Camera) -> Rays:
    width, height = camera.size
    x, y = torch.arange(width).to(camera.K), torch.arange(height).to(camera.K)
    return rays_through(torch.cartesian_prod(x, y), camera)


def _before(subject: Subject, state: PoseState, angle: float) -> Camera:
    """A camera that sees the whole person; the same at every precision."""
    # The bounds of float64 and float32 differ by rounding, the camera must not.
    bounds = state.bounds.float().double().cpu()
    return _rounded(looking(bounds, angle, (SIDE, SIDE), 1.0), subject)


def _rounded(camera: Camera, subject: Subject) -> Camera:
    return Camera(subject.tensor(camera.K), subject.tensor(camera.camera_from_body), camera.size)


def _moved(camera: Camera, shift: tuple[float, float, float]) -> Camera:
    matrix = camera.camera_from_body.clone()
    matrix[:3, 3] += matrix.new_tensor(shift)
    return replace(camera, camera_from_body=matrix)


def _upside_down(camera: Camera) -> Camera:
    turn = torch.diag(camera.K.new_tensor([-1.0, -1.0, 1.0, 1.0]))
    return replace(camera, camera_from_body=turn @ camera.camera_from_body)


def _shifted(camera: Camera) -> Camera:
    return _moved(camera, (0.6, 0.3, 0.0))


def _inside(camera: Camera) -> Camera:
    return _moved(camera, (0.1, 0.05, -float(camera.camera_from_body[2, 3]) * 0.95))


def _behind(bounds: Float[Tensor, "2 3"]) -> Camera:
    camera = looking(bounds, 0.4, (SIDE, SIDE), 1.0)
    return _moved(camera, (0.0, 0.0, -4 * float((bounds[1] - bounds[0]).norm())))


def _off(bounds: Float[Tensor, "2 3"]) -> Camera:
    camera = looking(bounds, 0.4, (SIDE, SIDE), 1.0)
    return _moved(camera, (5 * float((bounds[1] - bounds[0]).norm()), 0.0, 0.0))


def _large(bounds: Float[Tensor, "2 3"]) -> Camera:
    return looking(bounds, 0.4, (2048, 2048), 0.01)


__all__ = ["picture_cases", "scene", "sure_rays"]
