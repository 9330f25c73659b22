import dataclasses
import itertools
from collections.abc import Sequence

import pytest
import torch

from actorsnerf_model.actor_states import ActorsNeRFState
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.humannerf import HumanNeRFConfig
from actorsnerf_model.states import Counts
from actorsnerf_train.report import scaling
from actorsnerf_train.report.frames import Frame
from actorsnerf_train.report.measure import Contestant
from actorsnerf_train.report.scaling import part_rows, scaling_rows
from actorsnerf_train.trained import TrainedActor


def test_work_follows_the_person_and_the_samples_not_the_picture(
    contestants: list[Contestant], frames: tuple[Frame, ...]
) -> None:
    rows = scaling_rows(contestants[1], frames[0], 1)
    by_what: dict[str, list[tuple[str, int, int]]] = {}
    for row in rows:
        by_what.setdefault(row.what, []).append((row.value, row.rays, row.survivors))
        assert row.seconds > 0
    pictures = by_what["picture, same person"]
    assert [value for value, _, _ in pictures] == ["80x80", "160x160", "320x320"]
    assert len({(rays, survivors) for _, rays, survivors in pictures}) == 1
    persons = by_what["person and picture"]
    assert [value for value, _, _ in persons] == ["40x40", "80x80", "160x160"]
    for smaller, larger in itertools.pairwise(persons):
        assert 3.3 < larger[2] / smaller[2] < 4.7
    samples = by_what["samples per ray"]
    assert [value for value, _, _ in samples] == ["3", "6", "12", "24"]
    assert 3 < samples[3][2] / samples[1][2] < 5
    bones = by_what["bones"]
    assert [value for value, _, _ in bones] == ["6", "12", "24"]
    assert bones[0][2] < bones[1][2] < bones[2][2] == samples[2][2]


def test_parts_cost_what_they_multiply(
    trained: TrainedActor[ActorsNeRFState],
    contestants: list[Contestant],
    frames: tuple[Frame, ...],
) -> None:
    rows = {row.without: row for row in part_rows(trained, contestants[1], frames[0], 1)}
    assert list(rows) == [
        "nothing",
        "deformation",
        "pixel features",
        "body features",
        "views: 1 of 3",
        "views: 2 of 3",
    ]
    assert len({row.survivors for row in rows.values()}) == 1
    flops = {name: row.density_flops + row.colour_flops for name, row in rows.items()}
    assert all(count < flops["nothing"] for name, count in flops.items() if name != "nothing")
    assert flops["views: 1 of 3"] < flops["views: 2 of 3"]


def test_parts_are_timed_at_the_points_precision_and_all_they_see_is_coloured(
    trained: TrainedActor[ActorsNeRFState],
    contestants: list[Contestant],
    frames: tuple[Frame, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An actor that was trained in bfloat16 draws `complete` in float32, and so without a part."""
    other = dataclasses.replace(
        trained, config=dataclasses.replace(trained.config, precision="bfloat16")
    )
    found: list[tuple[torch.dtype, Counts]] = []
    in_turns = scaling._in_turns

    def listening(
        cases: Sequence[tuple[Contestant, Frame]], rounds: int
    ) -> list[tuple[list[float], Counts]]:
        timed = in_turns(cases, rounds)
        for (who, _), (_, counts) in zip(cases, timed, strict=True):
            assert isinstance(who.actor.method, ActorsNeRF)
            found.append((who.actor.method.network_dtype, counts))
        return timed

    monkeypatch.setattr(scaling, "_in_turns", listening)
    rows = part_rows(other, contestants[1], frames[0], 1)
    assert [dtype for dtype, _ in found] == [torch.float32] * len(rows)
    assert all(counts.painted == counts.survivors > 0 for _, counts in found)


def test_a_method_without_these_parts_has_no_rows(
    trained: TrainedActor[ActorsNeRFState],
    contestants: list[Contestant],
    frames: tuple[Frame, ...],
) -> None:
    config = dataclasses.replace(trained.config, model=HumanNeRFConfig())
    other = dataclasses.replace(trained, config=config)
    assert part_rows(other, contestants[1], frames[0], 1) == ()
