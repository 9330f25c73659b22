import pytest
import torch
from torch.nn import functional as F

from actorsnerf_model.canonical_networks import (
    CanonicalConfig,
    CanonicalField,
    MotionConfig,
    NonRigidMotion,
    PoseRefiner,
    RefinerConfig,
)
from actorsnerf_model.fourier import annealed_fourier_features, fourier_features
from actorsnerf_model.rotations import matrix_from_axis_angle


@pytest.mark.parametrize(
    ("network", "expected"),
    [
        (PoseRefiner(RefinerConfig()), 233_029),
        (NonRigidMotion(MotionConfig()), 101_123),
        (CanonicalField(CanonicalConfig()), 494_084),
    ],
)
def test_released_sizes(network: torch.nn.Module, expected: int) -> None:
    assert sum(p.numel() for p in network.parameters()) == expected


def test_a_fresh_refiner_all_but_keeps_the_pose(generator: torch.Generator) -> None:
    torch.manual_seed(0)
    pose = torch.randn(24, 3, generator=generator)
    turned = PoseRefiner(RefinerConfig(width=32, depth=2))(pose)
    torch.testing.assert_close(turned, matrix_from_axis_angle(pose), atol=1e-2, rtol=0)
    assert not torch.equal(turned[1:], matrix_from_axis_angle(pose)[1:])


def test_a_zero_pose_is_corrected_from_the_first_step_on(generator: torch.Generator) -> None:
    refiner = PoseRefiner(RefinerConfig(width=16, depth=2))
    pose = torch.zeros(24, 3)
    wanted = matrix_from_axis_angle(0.1 * torch.randn(24, 3, generator=generator))

    def pull(pose: torch.Tensor) -> dict[str, torch.Tensor]:
        refiner.zero_grad()
        (refiner(pose) - wanted).square().sum().backward()
        grads = {name: value.grad for name, value in refiner.named_parameters()}
        return {name: grad for name, grad in grads.items() if grad is not None and grad.any()}

    (only,) = pull(pose).items()
    assert only[0] == "correction.bias"
    assert only[1].isfinite().all() and (only[1] != 0).all()
    before = (refiner(pose) - wanted).square().sum()
    optimiser = torch.optim.SGD(refiner.parameters(), lr=0.1)
    optimiser.step()
    assert (refiner(pose) - wanted).square().sum() < 0.7 * before
    pull(0.3 * torch.randn(24, 3, generator=generator))  # another pose wakes the hidden layers
    optimiser.step()
    assert {"hidden.1.bias", "correction.weight"} <= pull(pose).keys()


def test_the_refiner_turns_each_joint_after_its_own_rotation() -> None:
    refiner = PoseRefiner(RefinerConfig(width=8, depth=1)).double()
    torch.nn.init.zeros_(refiner.correction.weight)
    turn = torch.linspace(-1, 1, 69, dtype=torch.float64)
    refiner.correction.bias.data.copy_(turn)
    pose = torch.linspace(2, -2, 72, dtype=torch.float64).reshape(24, 3)
    rotations = matrix_from_axis_angle(pose)
    expected = rotations[1:] @ matrix_from_axis_angle(turn.reshape(23, 3))
    found = refiner(pose)
    torch.testing.assert_close(found[1:], expected)
    torch.testing.assert_close(found[0], rotations[0])


def test_motion_equals_the_plain_form(generator: torch.Generator) -> None:
    config = MotionConfig(width=12, depth=4, skip=2, octaves=3)
    net = NonRigidMotion(config).double()
    torch.nn.init.normal_(net.offset.weight, generator=generator)
    points = torch.randn(9, 3, generator=generator, dtype=torch.float64)
    pose = torch.randn(24, 3, generator=generator, dtype=torch.float64)
    encoded = annealed_fourier_features(points, 3, 1.7)
    hidden = torch.cat([encoded, pose[1:].reshape(1, 69).expand(9, -1)], 1)
    for number, layer in enumerate(net.hidden):
        hidden = torch.cat([encoded, hidden], 1) if number == 2 else hidden
        hidden = F.relu(layer(hidden))
    torch.testing.assert_close(net(points, 1.7, pose), net.offset(hidden))


def test_field_equals_the_plain_form(generator: torch.Generator) -> None:
    net = CanonicalField(CanonicalConfig(width=16, depth=3, skip=1, octaves=2)).double()
    points = torch.randn(7, 3, generator=generator, dtype=torch.float64)
    encoded = fourier_features(points, 2, identity=True)
    first, second, third = net.hidden
    hidden = F.relu(second(torch.cat([encoded, F.relu(first(encoded))], 1)))
    raw = net.out(F.relu(third(hidden)))
    rgb, density = net(points)
    torch.testing.assert_close(rgb, raw[:, :3].sigmoid())
    torch.testing.assert_close(density, raw[:, 3].relu())


def test_no_points_at_all() -> None:
    empty, pose = torch.zeros(0, 3), torch.zeros(24, 3)
    rgb, density = CanonicalField(CanonicalConfig())(empty)
    assert rgb.shape == (0, 3)
    assert density.shape == (0,)
    assert NonRigidMotion(MotionConfig())(empty, 6.0, pose).shape == (0, 3)
