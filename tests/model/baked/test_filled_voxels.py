import torch
from torch import Tensor

from actorsnerf_model.baked.actor import BakedState
from actorsnerf_model.baked.bricks import VISIBLE_DENSITY, look_up
from actorsnerf_model.baked.filled_voxels import FilledVoxels, anchors, filled_voxels, grown
from actorsnerf_model.interpolation import trilinear
from actorsnerf_model.skinning import SkinningVolume, nodes_from_canonical


def cell_of(filled: FilledVoxels, points: Tensor) -> tuple[Tensor, ...]:
    x, y, z = ((points - filled.low) / filled.edge).floor().long().unbind(-1)
    return z, y, x


def test_every_visible_place_is_in_a_filled_cell(
    state: BakedState, generator: torch.Generator
) -> None:
    field = state.data.field
    filled = filled_voxels(field, 0.0)
    size = torch.tensor(field.index.shape[::-1]) * 4 * field.voxel
    points = field.low + torch.rand(20000, 3, generator=generator) * size
    _, density = look_up(state.table, points)
    seen = points[density > VISIBLE_DENSITY]
    assert seen.shape[0] > 200
    assert not filled.rings[cell_of(filled, seen)].any()
    assert float((filled.rings == 0).float().mean()) < 0.6


def test_rings_count_steps_to_the_nearest_filled_cell(state: BakedState) -> None:
    """Against the distances to all of them; and the border is out of reach."""
    filled = filled_voxels(state.data.field, 0.1)
    there = (filled.rings == 0).nonzero()
    some = torch.arange(filled.rings.numel())[:: 1 + filled.rings.numel() // 500]
    place = torch.stack(torch.unravel_index(some, filled.rings.shape), -1)
    steps = (place[:, None] - there).abs().amax(-1).amin(-1)
    assert torch.equal(filled.rings[place.unbind(-1)].long(), steps.clamp(max=4))
    assert set(steps.clamp(max=4).tolist()) == {0, 1, 2, 3, 4}
    for axis in range(3):
        for side in (0, -1):
            assert (filled.rings.select(axis, side) == 4).all()


def test_every_filled_place_has_an_anchor_of_each_bone_that_may_hold_it(
    state: BakedState, generator: torch.Generator
) -> None:
    filled, volume = state.filled, state.data.skinning
    known = anchors(filled, volume, 0.05, 0.005)
    cells = (filled.rings == 0).nonzero().flip(-1)
    cells = cells[torch.randint(0, cells.shape[0], (300,), generator=generator)]
    places = filled.low + (cells + torch.rand(300, 3, generator=generator)) * filled.edge
    rows = volume.weights.permute(1, 2, 3, 0)
    weights = trilinear(rows, nodes_from_canonical(places, volume))
    for bone, points in enumerate(known.points):
        held = places[weights[:, bone] > 0.05]
        if held.shape[0]:
            away = (held[:, :, None] - points).abs().amax(1).amin(1)
            assert float(away.max()) <= 0.05
        own = trilinear(rows[..., bone : bone + 1], nodes_from_canonical(points.T, volume))
        assert points.shape[1] == 0 or float(own.min()) >= 0.005 - 1e-6


def test_a_bone_without_weight_has_no_anchor(state: BakedState) -> None:
    volume = state.data.skinning
    weights = volume.weights.clone()
    weights[3] = 0
    known = anchors(state.filled, SkinningVolume(weights, volume.box), 0.05, 0.005)
    assert known.points[3].shape == (3, 0) and known.points[6].shape[1] > 0


def test_growing_is_to_all_neighbours() -> None:
    cells = torch.zeros(5, 6, 7, dtype=torch.bool)
    cells[2, 3, 3] = True
    wide = grown(cells)
    assert wide[1:4, 2:5, 2:5].all() and int(wide.sum()) == 27
    cells = torch.zeros(5, 6, 7, dtype=torch.bool)
    cells[0, 5, 0] = True
    assert int(grown(cells).sum()) == 8
