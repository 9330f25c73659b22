"""Three forms of a baked field, fitted to one actor: sparse grid, tri-planes, small network.

All stand for the same field (the actor's, moved by its mean deformation) and are asked at the same
random places near what can be seen. The learned two get the same processor time. Writes
`results/baked_forms.md` and `.json`.
"""

import argparse
import functools
import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from records import Table, record, timed
from torch import Tensor, nn
from torch.nn import functional as F

from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.baked.baking import BakeOptions, bake
from actorsnerf_model.baked.bricks import BrickGrid, brick_table, look_up
from actorsnerf_model.baked.bricks import density_from_activation as density_from
from actorsnerf_model.baked.filled_voxels import filled_voxels
from actorsnerf_train.checkpoint import load_checkpoint
from actorsnerf_train.trained import TrainedActor, load_trained

ACTOR = Path(__file__).resolve().parent.parent / "data/study/heldout00-fewshot-30-category"
SEED = 0
LENGTH = 0.01
"""Metres whose light is compared: colour times opacity, and opacity."""
NEAR = 0.02
"""Metres around what can be seen where places lie."""
PLACES = 300_000
HELD_OUT = 100_000
BATCH = 8192
RATE = 5e-3
Field = Callable[[Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class Places:
    """Where the field is asked, and what it says."""

    points: Float[Tensor, "places 3"]
    look: Float[Tensor, "places 4"]


class TriPlanes(nn.Module):
    """Features on three planes, summed, through one hidden layer."""

    def __init__(self, box: Tensor, spacing: float, channels: int = 16, width: int = 32) -> None:
        super().__init__()
        self.low, self.size = box[0], box[1] - box[0]
        nodes = [int(side / spacing) + 2 for side in (box[1] - box[0]).tolist()]
        self.planes = nn.ParameterList(
            nn.Parameter(0.1 * torch.randn(1, channels, nodes[b], nodes[a]))
            for a, b in ((0, 1), (0, 2), (1, 2))
        )
        self.head = nn.Sequential(nn.Linear(channels, width), nn.ReLU(), nn.Linear(width, 4))

    def forward(self, points: Tensor) -> Tensor:
        """Logits of colour and activation of density."""
        place = (points - self.low) / self.size * 2 - 1
        total: Any = 0.0
        for plane, axes in zip(self.planes, ((0, 1), (0, 2), (1, 2)), strict=True):
            read = F.grid_sample(plane, place[None, None][..., list(axes)], align_corners=True)
            total = total + read[0, :, 0].T
        result: Tensor = self.head(total)
        return result


class SmallNetwork(nn.Module):
    """Waves of the place through four layers."""

    def __init__(self, box: Tensor, octaves: int = 7, width: int = 64) -> None:
        super().__init__()
        self.low, self.size = box[0], (box[1] - box[0]).amax()
        self.waves: Tensor = 2.0 ** torch.arange(octaves) * torch.pi
        inputs = 3 + 6 * octaves
        layers: list[nn.Module] = [nn.Linear(inputs, width), nn.ReLU()]
        for _ in range(3):
            layers += [nn.Linear(width, width), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(width, 4))

    def forward(self, points: Tensor) -> Tensor:
        """Logits of colour and activation of density."""
        place = (points - self.low) / self.size * 2 - 1
        turned = (place[..., None] * self.waves).flatten(1)
        result: Tensor = self.layers(torch.cat([place, turned.sin(), turned.cos()], -1))
        return result


def look(rgb: Tensor, density: Tensor) -> Float[Tensor, "places 4"]:
    """What a stretch of `LENGTH` shows."""
    opacity = -torch.expm1(-density * LENGTH)[:, None]
    return torch.cat([rgb * opacity, opacity], -1)


def values(network: nn.Module, points: Tensor) -> tuple[Tensor, Tensor]:
    """Colour and density of a learned form."""
    out = network(points)
    return torch.sigmoid(out[:, :3]), density_from(out[:, 3])


def places(
    trained: TrainedActor[Any], method: ActorsNeRF, grid: BrickGrid, count: int, seed: int
) -> Places:
    """Random places near what can be seen, and the method's own answers."""
    filled = filled_voxels(grid, NEAR)
    cells = (filled.rings <= round(NEAR / grid.voxel)).nonzero().flip(-1)
    generator = torch.Generator().manual_seed(seed)
    chosen = cells[torch.randint(0, cells.shape[0], (count,), generator=generator)]
    points = filled.low + (chosen + torch.rand(count, 3, generator=generator)) * filled.edge
    poses = torch.stack([view.pose for view in trained.supports])
    looks = []
    with torch.no_grad():
        for part in torch.split(points, 16384):
            field = method.mean_field(trained.state, part, poses)
            looks.append(look(field.rgb.float(), field.density.float()))
    return Places(points, torch.cat(looks))


def fit(network: nn.Module, known: Places, seconds: float) -> nn.Module:
    """The network after so much processor time; its rate falls to nothing on the way."""
    generator = torch.Generator().manual_seed(SEED)
    optimiser = torch.optim.Adam(network.parameters(), RATE)
    began = time.process_time()
    while (spent := (time.process_time() - began) / seconds) < 1:
        optimiser.param_groups[0]["lr"] = RATE * max(1 - spent, 0.01)
        chosen = torch.randint(0, known.points.shape[0], (BATCH,), generator=generator)
        found = look(*values(network, known.points[chosen]))
        loss = (found - known.look[chosen]).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return network.half().float()


def row(name: str, size: int, field: Field, asked: Places) -> tuple[str | float, ...]:
    """A form's figures."""
    with torch.no_grad():
        error = (look(*field(asked.points)) - asked.look).square()
        some = asked.points[:100_000]
        took = timed(lambda: field(some), 5).cpu * 1e5 / some.shape[0]
    decibel = -10 * torch.log10(torch.stack([error[:, :3].mean(), error[:, 3].mean()]))
    return name, size / 1e6, took * 1e3, float(decibel[0]), float(decibel[1])


def main() -> None:
    """Fits, measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkpoint", type=Path, default=ACTOR, help="of a fitted actor")
    parser.add_argument("--seconds", type=float, default=45.0, help="processor time for each fit")
    options = parser.parse_args()
    if not options.checkpoint.exists():
        print(f"not measured: there is no fitted actor at {options.checkpoint}; give --checkpoint")
        return
    torch.manual_seed(SEED)
    trained = load_trained(options.checkpoint, torch.device("cpu"))
    method = trained.method
    assert isinstance(method, ActorsNeRF)
    grids = {}
    for voxel in (0.02, 0.012, 0.008):
        how = BakeOptions(voxel=voxel)
        grids[voxel] = bake(method, trained.state, trained.supports, how)[0].field
    fine = grids[0.008]
    known = places(trained, method, fine, PLACES, SEED)
    asked = places(trained, method, fine, HELD_OUT, SEED + 1)
    rows = []
    for voxel, grid in grids.items():
        table = brick_table(grid)
        name = f"sparse grid, {1e3 * voxel:g} mm"
        rows.append(row(name, grid.bytes, functools.partial(look_up, table), asked))
    box = torch.stack([known.points.amin(0), known.points.amax(0)])
    for name, network in (
        ("tri-planes, 8 mm, 16 channels", TriPlanes(box, 0.008)),
        ("tri-planes, 8 mm, 32 channels", TriPlanes(box, 0.008, 32, 64)),
        ("network, 4 layers of 64", SmallNetwork(box)),
        ("network, 4 layers of 128", SmallNetwork(box, width=128)),
    ):
        size = 2 * sum(parameter.numel() for parameter in network.parameters())
        fitted = fit(network, known, options.seconds)
        rows.append(row(name, size, functools.partial(values, fitted), asked))
    digest = hashlib.sha256(load_checkpoint(options.checkpoint).path.read_bytes()).hexdigest()
    columns = ("form", "MB", "ms for 100,000 look-ups", "colour, dB", "opacity, dB")
    remark = (
        f"Field of {trained.actor} (checkpoint sha256 {digest[:16]}), {HELD_OUT:,} places within "
        f"{NEAR * 100:g} cm of what can be seen; compared is what {LENGTH * 100:g} cm of it show "
        f"(colour times opacity, and opacity). Fits: {options.seconds:g} s of processor time on "
        f"{PLACES:,} other places. One thread; CPU time of look-ups. Stored in 8 bits (grid) and "
        "float16 (the others)."
    )
    record(
        "baked_forms",
        "Forms of a baked field",
        SEED,
        [Table("Forms", columns, tuple(rows), remark)],
    )


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
