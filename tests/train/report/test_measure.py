import time
from dataclasses import replace

import pytest
import torch
from torch import nn

from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_train.report import measure
from actorsnerf_train.report.frames import Frame
from actorsnerf_train.report.measure import (
    CHUNKS,
    Contestant,
    Effort,
    Measured,
    draw,
    field_flops,
    gemm_rate,
    shared_pixels,
)


def test_every_contestant_drew_every_frame(
    measured: tuple[Measured, ...], frames: tuple[Frame, ...]
) -> None:
    names = [one.contestant.name for one in measured]
    assert names == ["reference", "complete", "exact", "half-samples", "bfloat16"]
    for one in measured:
        assert len(one.drawn) == len(frames)
        assert 0 < one.times.low <= one.times.median <= one.times.high
        assert one.flops.density > 0 and one.flops.colour > 0 and one.limit > 0 and one.of_limit > 0
    by_name = dict(zip(names, measured, strict=True))
    assert by_name["reference"].contestant.actor.config.render.chunk in CHUNKS
    # 12 samples a ray, every one through the networks; the cull drops nearly all.
    assert by_name["reference"].survivors == by_name["reference"].samples
    assert by_name["reference"].samples == 12 * by_name["reference"].rays
    assert by_name["exact"].survivors <= by_name["complete"].survivors
    assert by_name["complete"].survivors < by_name["reference"].survivors / 4
    assert by_name["half-samples"].samples < by_name["exact"].samples


def test_work_of_a_share_is_scaled_to_the_frame(
    contestants: list[Contestant], frames: tuple[Frame, ...], measured: tuple[Measured, ...]
) -> None:
    effort = Effort(1, 0.25, 0)
    drawn = draw(contestants[0], frames[0], effort)
    assert drawn.pixels is not None
    box = int(frames[0].box.sum())
    assert drawn.pixels.shape[0] == round(0.25 * box)
    assert drawn.rendering.counts.samples < 12 * box / 3
    # Whole and share agree where both drew.
    whole = measured[0].drawn[0]
    assert whole.pixels is not None and whole.pixels.shape[0] == box
    assert abs(measured[0].drawn[0].rendering.counts.rays - box) <= 0.01 * box


def test_only_the_rays_time_is_scaled_to_the_frame(
    contestants: list[Contestant], frames: tuple[Frame, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pose is needed once, however many rays are drawn: 1 s, and 2 s for a quarter of them."""
    clock = iter([10.0, 11.0, 13.0])
    monkeypatch.setattr(measure, "now", lambda device: next(clock))
    seconds = measure._seconds(contestants[0], frames[0], Effort(1, 0.25, 0))
    assert seconds == pytest.approx(1 + 4 * 2, rel=0.02)


@pytest.mark.parametrize(
    ("took", "passed", "median"),
    [
        ([0.9, 0.7, 0.1, 0.2], [0.7, 1.4, 1.9, 2.1], 0.45),  # for 2 s
        ([5.0, 1.0, 2.0], [1.5, 3.0, 9.9], 2.0),  # then three times
        ([6.0, 4.0], [6.0, 10.0], 5.0),  # but not after 10 s
        ([11.0], [11.0], 11.0),
    ],
)
def test_what_is_done_soon_is_done_again_and_its_median_counts(
    took: list[float], passed: list[float], median: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measure, "BRIEF", 2.0)
    monkeypatch.setattr(measure, "TURNS", 3)
    clock, told = iter([100.0, *(100 + one for one in passed)]), iter(took)
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    assert measure.settled(lambda: next(told)) == pytest.approx(median)
    assert not list(clock) and not list(told)


def test_a_round_is_the_mean_over_the_frames(
    contestants: list[Contestant], frames: tuple[Frame, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    took = iter([5.0, 1.0])
    monkeypatch.setattr(measure, "_seconds", lambda *given: next(took))
    monkeypatch.setattr(measure, "settled", lambda turn: turn())
    two = (frames[0], frames[0])
    assert measure._round(contestants[0], two, Effort(1, 1.0, 0)) == 3.0


def test_products_are_timed_just_before_every_turn(
    contestants: list[Contestant], frames: tuple[Frame, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three points take turns, two rounds; those of one precision have one yardstick."""
    told: list[str] = []
    paces = {"float32": iter([1.0, 2.0, 4.0, 90.0]), "bfloat16": iter([20.0, 40.0])}

    def rate(precision: str, device: torch.device) -> float:
        told.append(precision)
        return next(paces[precision])

    def turn(contestant: Contestant, *given: object) -> float:
        told.append(contestant.name)
        return 1.0

    monkeypatch.setattr(measure, "gemm_rate", rate)
    monkeypatch.setattr(measure, "_round", turn)
    three = [replace(contestants[1], name=name) for name in ("first", "second", "third")]
    three[1] = replace(three[1], precision="bfloat16")
    found = measure.measure(three, frames[:1], Effort(2, 1.0, 0))
    precisions = {"first": "float32", "second": "bfloat16", "third": "float32"}
    order = ("first", "second", "third", "second", "third", "first")
    assert told == [said for name in order for said in (precisions[name], name)]
    assert [one.limit for one in found] == [3.0, 30.0, 3.0]


def test_shares_lie_in_the_box_and_follow_the_seed(frames: tuple[Frame, ...]) -> None:
    pixels = shared_pixels(frames[0], Effort(1, 0.1, 3))
    assert bool(frames[0].box[pixels[:, 1], pixels[:, 0]].all())
    assert torch.equal(pixels, shared_pixels(frames[0], Effort(1, 0.1, 3)))
    assert not torch.equal(pixels, shared_pixels(frames[0], Effort(1, 0.1, 4)))
    assert len(torch.unique(pixels, dim=0)) == len(pixels)


def test_flops_are_those_of_the_networks(
    contestants: list[Contestant], frames: tuple[Frame, ...]
) -> None:
    method = contestants[1].actor.method
    assert isinstance(method, ActorsNeRF)
    radiance = method.radiance
    width, code, position = radiance.config.width, radiance.config.code, 3 * 9
    views = method.config.views
    products = 2 * width * code * (1 + views)  # first layers of both branches, body and views
    products += radiance.body.weight.numel() if radiance.body is not None else 0
    products += width * (width + position) + 2 * width * width + width  # density
    products += position * width + views * width * width + 2 * width * width + 3 * width
    assert method.deformation is not None
    weights = [layer.weight for layer in method.deformation.hidden if isinstance(layer, nn.Linear)]
    products += sum(weight.numel() for weight in weights)
    products -= 2 * 69 * weights[0].shape[0]  # the pose's share is computed once
    products += method.deformation.offset.weight.numel()
    found = field_flops(contestants[1], frames[0])
    assert 2 * products <= found.density + found.colour <= 1.05 * 2 * products  # some geometry
    colour = width * code * (1 + views) + position * width + views * width * width
    assert found.colour == 2 * (colour + 2 * width * width + 3 * width)


def test_the_machines_rate_is_a_number() -> None:
    assert gemm_rate("float32", torch.device("cpu")) > 1e6
