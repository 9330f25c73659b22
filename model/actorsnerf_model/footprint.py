"""Which pixels of a picture can show the person: the shadow of the occupied cells."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from actorsnerf_model.projection import NEAR_PLANE, project
from actorsnerf_model.states import Camera, PoseState

PIXEL_SLACK = 0.05
"""Pixels around each cell's shadow, against rounding."""


@torch.no_grad()
def footprint(pose: PoseState, camera: Camera, occupancy: bool) -> Bool[Tensor, "height width"]:
    """True for every pixel whose ray can meet an occupied cell, and for few others.

    A cell's shadow lies in the rectangle around its projected corners. A cell that reaches behind
    the camera may cast its shadow anywhere.

    Args:
        pose: its occupied cells, or its bounds where it has none.
        camera: of the picture.
        occupancy: whether to use the cells at all.
    """
    corners = _cell_corners(pose, occupancy)
    seen = project(corners.reshape(-1, 3), camera.K, camera.camera_from_body)
    shape = corners.shape[:2]
    pixels, depth = seen.pixels.reshape(*shape, 2), seen.depth.reshape(shape)
    size = pixels.new_tensor(camera.size)
    low = torch.ceil(pixels.amin(1) - PIXEL_SLACK)
    high = torch.floor(pixels.amax(1) + PIXEL_SLACK) + 1
    anywhere = (depth.amin(1) <= NEAR_PLANE)[:, None]
    nowhere = (depth.amax(1) <= NEAR_PLANE)[:, None]
    low = torch.where(anywhere, 0, low).maximum(torch.zeros_like(low)).minimum(size)
    high = torch.where(anywhere, size, high).maximum(low).minimum(size)
    high = torch.where(nowhere, low, high)
    return _union(low.long(), high.long(), camera.size)


def _cell_corners(pose: PoseState, occupancy: bool) -> Float[Tensor, "cells 8 3"]:
    unit = torch.cartesian_prod(*[pose.bounds.new_tensor([0.0, 1.0])] * 3)
    if not occupancy or pose.occupancy is None:
        return (pose.bounds[0] + unit * (pose.bounds[1] - pose.bounds[0]))[None]
    grid = pose.occupancy
    edges = (grid.box[1] - grid.box[0]) / grid.box.new_tensor(grid.cells.shape)
    cells = grid.cells.nonzero().to(edges.dtype)
    return grid.box[0] + (cells[:, None] + unit) * edges


def _union(low: Tensor, high: Tensor, size: tuple[int, int]) -> Bool[Tensor, "height width"]:
    """The pixels of low <= pixel < high of any rectangle: corners counted, then summed up."""
    width, height = size
    count = torch.zeros((height + 1) * (width + 1), dtype=torch.int32, device=low.device)
    for x, y, sign in ((low, low, 1), (high, high, 1), (low, high, -1), (high, low, -1)):
        place = y[:, 1] * (width + 1) + x[:, 0]
        count.index_add_(0, place, torch.full_like(place, sign, dtype=torch.int32))
    table = count.reshape(height + 1, width + 1).cumsum(0).cumsum(1)
    return table[:height, :width] > 0


__all__ = ["footprint"]
