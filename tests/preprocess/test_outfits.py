import dataclasses

import numpy as np
import pytest

from actorsnerf_datasets.types import Role
from actorsnerf_preprocess.outfits import COLOURS, MARKS, PATTERNS, Outfit, draw_outfit


def outfits(role: Role, count: int = 8) -> list[Outfit]:
    return [draw_outfit(np.random.default_rng([0, index]), index, role) for index in range(count)]


@pytest.mark.parametrize("choice", [PATTERNS, MARKS, COLOURS], ids=["patterns", "marks", "colours"])
def test_held_out_actors_wear_what_no_training_actor_wears(
    choice: dict[Role, tuple[object, ...]],
) -> None:
    assert not set(choice["pretraining"]) & set(choice["held_out"])


@pytest.mark.parametrize("role", ["pretraining", "held_out"])
def test_an_outfit_keeps_to_the_fabrics_of_its_role(role: Role) -> None:
    for outfit in outfits(role):
        assert outfit.top.pattern in PATTERNS[role]
        assert outfit.bottom.pattern in (*PATTERNS[role], "plain")
        assert {outfit.front_mark, outfit.back_mark} <= set(MARKS[role])
        assert {outfit.top.colour, outfit.top.second, outfit.bottom.colour} <= set(COLOURS[role])
        assert outfit.top.colour != outfit.top.second
        assert outfit.front_mark != outfit.back_mark


def test_training_actors_differ_in_hair_cut_and_mark() -> None:
    worn = outfits("pretraining")
    assert len({outfit.hair_style for outfit in worn}) == 5
    assert {outfit.bottom_cut for outfit in worn} == {"trousers", "shorts", "skirt"}
    assert len({outfit.front_mark for outfit in worn[:4]}) == 4
    assert len({outfit.skin for outfit in worn}) > 2


def test_the_seed_decides_the_outfit() -> None:
    first, again = outfits("held_out"), outfits("held_out")
    assert first == again
    other = draw_outfit(np.random.default_rng(9), 0, "held_out")
    assert dataclasses.astuple(other) != dataclasses.astuple(first[0])


def test_cloth_ends_above_the_ground_and_hems_lie_above_the_leg_ends() -> None:
    for outfit in (*outfits("pretraining"), *outfits("held_out")):
        assert -1.1 < outfit.leg_end < outfit.top_hem < 0
        assert 0.2 < outfit.sleeve_end < 0.7
        assert 0 < outfit.bottom_ease < outfit.top_ease + 0.02
