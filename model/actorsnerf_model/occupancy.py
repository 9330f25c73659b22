"""Which parts of the space around a posed person can hold any of it.

Per actor: tables of each bone's largest weight within reach of a cell. Per pose: every bone adds
its largest weight to the cells that it can touch. A cell whose sum stays below the threshold holds
no point that passes the foreground test, wherever in the cell the point lies.
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.skinning import SkinningVolume
from actorsnerf_model.skinning_bounds import SLACK, SkinningBounds
from actorsnerf_model.states import Occupancy

CELL = 0.03
"""Edge of an occupancy cell, metres."""


@dataclass(frozen=True)
class OccupancyTables:
    """Each bone's largest weight in the reach of a cell, over a fine grid around the bone."""

    peaks: tuple[Float[Tensor, "..."], ...]
    """24 tables with axes z, y, x."""
    low: Float[Tensor, "24 3"]
    """Where the tables begin, canonical frame, metres."""
    spacing: Float[Tensor, "3"]
    """Of the tables, metres."""
    cell: float
    """Edge of the cells that the tables are for, metres."""
    level: float
    """Weight that a bone may have outside its table."""


def asks_every_sample(device: torch.device) -> bool:
    """Whether to go without cells: in a training step on a GPU.

    The grid has the size of the pose, so making it needs numbers of the pose on the host, which
    would wait for the GPU's last step; and the cells are no fewer than a step's samples, which the
    foreground test, made on the GPU alone, may as well be asked about directly. The samples that
    pass are the same.

    >>> asks_every_sample(torch.device("cpu")), asks_every_sample(torch.device("cuda"))
    (False, True)
    """
    return device.type != "cpu" and torch.is_grad_enabled()


@torch.no_grad()
def occupancy_tables(
    volume: SkinningVolume, bounds: SkinningBounds, cell: float = CELL
) -> OccupancyTables:
    """The tables of an actor.

    The volume is refined by whole factors, so that its old nodes stay nodes and a fine cell's
    largest weight is at one of its corners; then every entry takes the maximum over all fine cells
    that a cell of the posed space around it can touch, however it is turned.

    Args:
        volume: skinning weights.
        bounds: of this volume.
        cell: edge of the occupancy cells, metres.
    """
    sizes = torch.tensor(volume.weights.shape[:0:-1], device=volume.box.device)
    coarse = (volume.box[1] - volume.box[0]) / (sizes - 1)
    factors = (coarse / (cell / 1.5)).round().long().clamp(min=1)
    spacing = coarse / factors
    radius = cell * math.sqrt(3) / 2 + 2 * SLACK
    reach = torch.ceil(radius / spacing).long()
    # Nodes of each bone's box in a volume with one more layer of zeros around it.
    nodes = torch.round((bounds.boxes.clamp(-1e4, 1e4) - volume.box[0]) / coarse).long() + 1
    nodes = nodes.clamp(torch.zeros_like(sizes), sizes + 1)
    begin, end = nodes[:, 0], nodes[:, 1]
    low = volume.box[0] + (begin - 1) * coarse - (reach + 1) * spacing
    padded = F.pad(volume.weights, (1, 1, 1, 1, 1, 1))
    fine, wide, *ends = torch.stack([factors.flip(0), reach.flip(0), *begin, *end]).tolist()
    peaks = []
    for weights, first, last in zip(padded, ends[:24], ends[24:], strict=True):
        crop = weights[first[2] : last[2] + 1, first[1] : last[1] + 1, first[0] : last[0] + 1]
        peaks.append(_peaks(crop, fine, wide))
    return OccupancyTables(tuple(peaks), low, spacing, cell, bounds.level)


@torch.no_grad()
def pose_occupancy(
    tables: OccupancyTables,
    canonical_from_body: Float[Tensor, "24 4 4"],
    bounds: Float[Tensor, "2 3"],
    threshold: float,
) -> Occupancy:
    """The cells of a pose that can hold a point of likelihood >= threshold; never one too few.

    The grid's size follows from the pose: one transfer to the host, for all bones together.

    Args:
        tables: of the actor.
        canonical_from_body: the bones' motions.
        bounds: box to cover, posed body frame, metres.
        threshold: likelihood.
    """
    cell = tables.cell
    sizes = torch.ceil((bounds[1] - bounds[0]) / cell).long().clamp(min=1)
    first, last = _touched(tables, canonical_from_body, bounds[0], sizes)
    shape, *ends = torch.stack([sizes, *first, *last]).tolist()
    total = bounds.new_zeros(shape)
    needed = threshold * (1 - 1e-4) - 24 * tables.level
    # Place of cell (0, 0, 0)'s middle, and one cell's step along x, y, z, in fine cells.
    motions = canonical_from_body[:, :3]
    # Sums of products here and below: autocast would halve a matrix product's precision.
    middle = (motions[..., :3] * (bounds[0] + cell / 2)).sum(-1) + motions[..., 3]
    start = (middle - tables.low) / tables.spacing
    steps = motions[..., :3] * (cell / tables.spacing)[:, None]
    for bone, (begin, end) in enumerate(zip(ends[:24], ends[24:], strict=True)):
        if any(a >= b for a, b in zip(begin, end, strict=True)) or not tables.peaks[bone].numel():
            continue
        part = tuple(slice(a, b) for a, b in zip(begin, end, strict=True))
        total[part] += _looked_up(tables.peaks[bone], start[bone], steps[bone], begin, end)
    box = torch.stack([bounds[0], bounds[0] + sizes * cell])
    return Occupancy(box, total >= needed, threshold)


def _touched(
    tables: OccupancyTables,
    canonical_from_body: Float[Tensor, "24 4 4"],
    low: Float[Tensor, "3"],
    sizes: Tensor,
) -> tuple[Tensor, Tensor]:
    """First and one past the last cell, per bone and axis, that its table can touch."""
    shapes = torch.tensor([list(reversed(peak.shape)) for peak in tables.peaks], device=low.device)
    half = shapes * tables.spacing / 2
    rotation, translation = canonical_from_body[:, :3, :3], canonical_from_body[:, :3, 3]
    back = rotation.transpose(-1, -2)
    middle = (back * (tables.low + half - translation)[..., None, :]).sum(-1)
    extent = (back.abs() * half[..., None, :]).sum(-1)
    first = torch.floor((middle - extent - low) / tables.cell).long() - 1
    last = torch.ceil((middle + extent - low) / tables.cell).long() + 1
    nothing = torch.zeros_like(sizes)
    return first.clamp(nothing, sizes), last.clamp(nothing, sizes)


def _looked_up(
    peaks: Float[Tensor, "z y x"],
    start: Float[Tensor, "3"],
    steps: Float[Tensor, "3 3"],
    begin: list[int],
    end: list[int],
) -> Float[Tensor, "cx cy cz"]:
    """Table entries at the middles of a block of cells; zero outside the table."""
    along = [
        torch.arange(a, b, device=start.device, dtype=start.dtype)
        for a, b in zip(begin, end, strict=True)
    ]
    flat, inside = None, None
    for axis, size in enumerate(peaks.shape[::-1]):
        place = (
            (along[0] * steps[axis, 0] + start[axis])[:, None, None]
            + (along[1] * steps[axis, 1])[:, None]
            + along[2] * steps[axis, 2]
        ).floor()
        within = (place >= 0) & (place < size)
        place = place.clamp(0, size - 1).long() * math.prod(peaks.shape[3 - axis :])
        flat = place if flat is None else flat + place
        inside = within if inside is None else inside & within
    assert flat is not None and inside is not None
    return peaks.reshape(-1)[flat] * inside


def _peaks(
    weights: Float[Tensor, "z y x"], factors: list[int], reach: list[int]
) -> Float[Tensor, "fz fy fx"]:
    """Largest refined weight within `reach` fine cells of every fine cell, and around them."""
    if weights.numel() == 0:
        return weights
    sizes = [(size - 1) * factor + 1 for size, factor in zip(weights.shape, factors, strict=True)]
    fine = F.interpolate(weights[None, None], sizes, mode="trilinear", align_corners=True)
    pads = [2 * reach[axis] + 1 for axis in (2, 1, 0)]
    fine = F.pad(fine, [pad for pad in pads for _ in range(2)])
    peaks = fine[0, 0]
    for axis in range(3):
        peaks = window_max(peaks, axis, 2 * reach[axis] + 2)
    return peaks


def window_max(values: Float[Tensor, "*grid"], axis: int, width: int) -> Float[Tensor, "*windows"]:
    """Maxima over each `width` neighbours of an axis, by doubling: far cheaper than pooling."""
    done = 1
    while done < width:
        step = min(done, width - done)
        length = values.shape[axis] - step
        values = values.narrow(axis, 0, length).maximum(values.narrow(axis, step, length))
        done += step
    return values


__all__ = [
    "CELL",
    "OccupancyTables",
    "asks_every_sample",
    "occupancy_tables",
    "pose_occupancy",
    "window_max",
]
