import dataclasses

import pytest
import torch

from actorsnerf_train.report.errors import SAME, errors, health, to_reference, to_truth
from actorsnerf_train.report.frames import Frame
from actorsnerf_train.report.measure import Measured


def moved(one: Measured, by: float) -> Measured:
    """The same pictures with one red value of the first frame's reference pixels changed."""
    drawn = one.drawn[0]
    rgb = drawn.rendering.rgb.clone()
    rgb[..., 0] += by
    first = dataclasses.replace(drawn, rendering=dataclasses.replace(drawn.rendering, rgb=rgb))
    return dataclasses.replace(one, drawn=(first, *one.drawn[1:]))


def test_exact_is_exact_and_the_others_say_how_far_they_are(
    measured: tuple[Measured, ...], frames: tuple[Frame, ...]
) -> None:
    found = dict(
        zip(
            [one.contestant.name for one in measured],
            errors(measured, frames, None),
            strict=True,
        )
    )
    assert found["reference"].reference.largest == 0
    assert found["complete"].reference.largest <= 1e-4
    assert found["complete"].reference.largest_anywhere == 0
    assert found["exact"].reference.largest <= SAME and found["exact"].reference.same
    assert found["half-samples"].reference.largest > SAME
    assert not found["half-samples"].reference.same
    for name in ("complete", "exact"):
        reference, own = found["reference"].truth, found[name].truth
        assert reference is not None and own is not None
        assert own.psnr == pytest.approx(reference.psnr, abs=0.05)
        assert own.lpips_x1000 is None


def test_a_known_difference_is_found(measured: tuple[Measured, ...]) -> None:
    reference, complete = measured[0], measured[1]
    found = to_reference(moved(complete, 0.1), reference, complete)
    assert found.largest == pytest.approx(0.1, abs=1e-4)
    assert found.largest_anywhere == pytest.approx(0.1, abs=1e-5)
    counts = [one.pixels.shape[0] for one in reference.drawn if one.pixels is not None]
    assert found.mean == pytest.approx(0.1 / 3 * counts[0] / sum(counts), rel=1e-3)
    squared = 0.01 / 3 * counts[0] / sum(counts)
    assert found.psnr == pytest.approx(-10 * torch.tensor(squared).log10().item(), abs=0.01)


def test_a_share_of_the_reference_has_no_true_score(
    measured: tuple[Measured, ...], frames: tuple[Frame, ...]
) -> None:
    reference = measured[0]
    drawn = reference.drawn[0]
    assert drawn.pixels is not None
    whole = drawn.rendering
    rendering = dataclasses.replace(
        whole, rgb=whole.rgb[:10], alpha=whole.alpha[:10], depth=whole.depth[:10]
    )
    few = dataclasses.replace(drawn, rendering=rendering, pixels=drawn.pixels[:10])
    one = dataclasses.replace(reference, drawn=(few, few))
    assert to_truth(one, frames, None) is None


def test_health_is_the_opacity_on_the_person(
    measured: tuple[Measured, ...], frames: tuple[Frame, ...]
) -> None:
    complete = measured[1]
    found = health(complete, to_truth(complete, frames, None), frames)
    assert 0.05 < found.alpha_inside <= 1
    assert 3 < found.psnr < 40
