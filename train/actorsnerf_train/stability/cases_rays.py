"""Hard cases of rays: box faces, edges and corners, cameras inside and behind, far away, tiny."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.projection import project
from actorsnerf_model.rays import Rays, intersect_box, rays_through, sample_depths, spacings
from actorsnerf_model.states import Camera
from actorsnerf_train.invented_actor import camera_around
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject

SPAN = Bounds(1e-12, 2e-5, 2e-5)
"""Metres of depth, rays of a few metres."""
DEPTHS = Bounds(1e-12, 2e-6, 2e-6)
BOX = ((-0.5, -1.0, -0.25), (0.5, 1.0, 0.75))
"""Metres; corners that float32 holds exactly."""
Place = tuple[float | int, float | int, float | int]
_RAYS: dict[str, tuple[Place, Place, tuple[float, float] | None]] = {
    "through the middle": ((0, 0, -3), (0, 0, 1), (2.75, 3.75)),
    "in a face": ((0.5, 0, -3), (0, 0, 1), (2.75, 3.75)),
    "in a face, slanting": ((0.5, -3, -3), (0, 1, 1), (2.75, 3.75)),
    "along an edge": ((0.5, 1, -3), (0, 0, 1), (2.75, 3.75)),
    "through an edge, into the box": ((1.5, 0, 0.75), (-1, 0, -0.5), (1.0, 2.0)),
    "through an edge, from outside": ((1.5, 0, -0.25), (-1, 0, -1), None),
    "through a corner, into the box": ((1.5, 2, 1.75), (-1, -1, -1), (1.0, 2.0)),
    "through a corner, past the box": ((1.5, 1, -0.25), (-1, 1, 0), None),
    "beside the box, parallel to it": ((0.625, 0, -3), (0, 0, 1), None),
    "from the box's middle": ((0, 0, 0.25), (1, 0, 0), (0.01, 0.5)),
    "from a face outward": ((0.5, 0, 0), (1, 0, 0), None),
    "from a face inward": ((0.5, 0, 0), (-1, 0, 0), (0.01, 1.0)),
    "from a corner inward": ((0.5, 1, 0.75), (-1, -1, -0.5), (0.01, 1.0)),
    "box behind the camera": ((0, 0, 3), (0, 0, 1), None),
    "box 1 mm before the camera": ((0, 0, 0.7509765625), (0, 0, -1), (0.01, 1.0009765625)),
    "from 1 km": ((0, 0, -1000), (0, 0, 1), (999.75, 1000.75)),
    "from 1 km, slanting": ((0, 0, -1000), (1e-4, 1e-4, 1), (999.75, 1000.75)),
    "nearly parallel to a face": ((0.25, 0, -3), (1e-30, 0, 1), (2.75, 3.75)),
    "far longer than a metre": ((0, 0, -3), (0, 1e10, 1), None),
}
"""Origin, direction, and where the ray runs inside, worked out by hand."""


def ray_cases() -> list[Case]:
    """The cases of rays alone; pictures have their own."""
    cases = [_span(name, *ray) for name, ray in _RAYS.items()]
    cases += [_layout("samples of a ray of no length", 0.0), _layout("samples of 1 um", 1e-6)]
    cases += [_behind("at the camera's centre", 0.0), _behind("behind the camera", -2.0)]
    cases += [_behind("on the near plane", 0.01), _behind("1 um behind the camera", -1e-6)]
    cases += [_large_picture(4096), _large_picture(16384)]
    return cases


def _span(name: str, origin: Place, direction: Place, expected: tuple[float, float] | None) -> Case:
    def answer(subject: Subject) -> Answer:
        start = subject.tensor(torch.tensor(origin, dtype=torch.float64)).requires_grad_()
        way = subject.tensor(torch.tensor([direction], dtype=torch.float64)).requires_grad_()
        box = subject.tensor(torch.tensor(BOX, dtype=torch.float64))
        span = intersect_box(Rays(start, way), box)
        gradients = torch.autograd.grad((span.far - span.near).sum(), (start, way))
        return Answer(_as_row(span.near, span.far, span.hit), gradients)

    def truth(subject: Subject) -> Answer:
        hit = subject.like.new_tensor([expected is not None], dtype=torch.bool)
        near, far = expected or (0.0, 0.0)
        return Answer(_as_row(subject.like.new_tensor([near]), subject.like.new_tensor([far]), hit))

    bounds = Bounds(1e-9, 1e-3, 1e-3) if abs(origin[2]) > 100 else SPAN
    measured = "entry, exit (m) and hit, against hand numbers"
    return Case("ray", name, measured, bounds, answer, truth)


def _as_row(near: Tensor, far: Tensor, hit: Tensor) -> Tensor:
    return torch.stack([near.detach(), far.detach(), hit.to(near.dtype)], -1)


def _layout(name: str, length: float) -> Case:
    def answer(subject: Subject) -> Answer:
        near = subject.like.new_tensor([2.0]).requires_grad_()
        far = subject.like.new_tensor([2.0]) + length
        rays = Rays(near.new_zeros(3), near.new_tensor([[0.0, 0.5, 1.0]]))
        depths = sample_depths(near, far, 128, None)
        steps = spacings(depths, near, far, rays)
        values = torch.cat([depths, steps], -1)
        return Answer(values.detach(), torch.autograd.grad(values.sum(), (near,)))

    return Case("ray", name, "depths and spacings (m)", DEPTHS, answer)


def _behind(name: str, depth: float) -> Case:
    """Points around the centre of a camera, whose projection divides by little or by nothing."""

    def answer(subject: Subject) -> Answer:
        points = torch.tensor([[0, 0, depth], [0.3, -0.2, depth], [-1e3, 1e3, depth]])
        points = subject.tensor(points).requires_grad_()
        K = _intrinsics(subject, 512)
        seen = project(points, K, torch.eye(4).to(points))
        gradients = torch.autograd.grad(seen.pixels.sum() + seen.depth.sum(), (points,))
        count = subject.like.new_tensor([float(seen.in_front.sum())])
        return Answer(torch.cat([count, torch.isfinite(seen.pixels).to(count).reshape(-1)]),
                      gradients)  # fmt: skip

    def truth(subject: Subject) -> Answer:
        return Answer(subject.like.new_tensor([0.0] + [1.0] * 6))

    measured = "points that count as seen; finite pixels"
    return Case("projection", name, measured, Bounds(0.0, 0.0, 0.0), answer, truth)


def _large_picture(side: int) -> Case:
    """Rays through the corners of a large picture, and back to its pixels."""

    def answer(subject: Subject) -> Answer:
        last = side - 1.0
        pixels = torch.tensor([[0, 0], [last, 0], [0, last], [last, last], [last / 2, last / 3]])
        given = subject.tensor(pixels)
        turn = torch.eye(4).to(given)
        turn[:3, 3] = given.new_tensor([0.25, -0.5, 3.0])
        camera = Camera(_intrinsics(subject, side), turn, (side, side))
        rays = rays_through(given, camera)
        points = (rays.origin + 3 * rays.directions).requires_grad_()
        seen = project(points, camera.K, turn)
        return Answer(seen.pixels.detach(), torch.autograd.grad(seen.pixels.sum(), (points,)))

    def truth(subject: Subject) -> Answer:
        last = side - 1.0
        pixels = torch.tensor([[0, 0], [last, 0], [0, last], [last, last], [last / 2, last / 3]])
        return Answer(subject.tensor(pixels))

    name = f"picture of {side} x {side} pixels"
    bounds = Bounds(1e-9, side * 1e-6, side * 1e-6, gradient=1e-4)
    return Case("projection", name, "pixel to ray to pixel (pixels)", bounds, answer, truth)


def looking(
    bounds: Float[Tensor, "2 3"], angle: float, size: tuple[int, int], fill: float
) -> Camera:
    """A camera that looks at the middle of a box from the side.

    Args:
        bounds: body frame, metres.
        angle: radians about the body's vertical axis.
        size: width, height in pixels.
        fill: how many times the box's diagonal fills the picture's height; small is far away.
    """
    reach = float((bounds[1] - bounds[0]).norm())
    distance = 1.5 * reach
    focal = size[1] * fill * distance / reach
    K = bounds.new_tensor([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1]])
    return Camera(K, camera_around(bounds.mean(0), angle, distance), size)


def _intrinsics(subject: Subject, side: int) -> Float[Tensor, "3 3"]:
    focal, middle = 1.2 * side, side / 2 - 0.5
    return subject.like.new_tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]])


__all__ = ["looking", "ray_cases"]
