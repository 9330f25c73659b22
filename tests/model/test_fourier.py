import math

import torch

from actorsnerf_model.fourier import (
    annealed_fourier_features,
    fourier_features,
    hann_window,
)


def test_hand_numbers() -> None:
    value = torch.tensor([[0.5, -1.0, 2.0]], dtype=torch.float64)
    features = fourier_features(value, 2, identity=True)[0].tolist()
    expected = [0.5, -1.0, 2.0]
    for scale in (1, 2):
        expected += [math.sin(scale * x) for x in (0.5, -1.0, 2.0)]
        expected += [math.cos(scale * x) for x in (0.5, -1.0, 2.0)]
    assert features == expected


def test_feature_counts_of_the_released_sizes() -> None:
    points = torch.zeros(5, 3)
    assert fourier_features(points, 10, identity=True).shape == (5, 63)
    assert fourier_features(points, 6).shape == (5, 36)


def test_window_opens_octave_by_octave() -> None:
    assert hann_window(0.0, 6) == (0.0,) * 6
    assert hann_window(6.0, 6) == (1.0,) * 6
    window = hann_window(2.5, 6)
    assert window[:2] == (1.0, 1.0)
    assert abs(window[2] - 0.5) < 1e-12
    assert window[3:] == (0.0,) * 3


def test_annealing_weighs_whole_octaves() -> None:
    points = torch.linspace(-1, 1, 12, dtype=torch.float64).reshape(4, 3)
    plain = fourier_features(points, 3)
    annealed = annealed_fourier_features(points, 3, 1.5)
    weights = torch.tensor(hann_window(1.5, 3), dtype=torch.float64)
    for octave in range(3):
        part = slice(6 * octave, 6 * octave + 6)
        torch.testing.assert_close(annealed[:, part], plain[:, part] * weights[octave])


def test_gradient() -> None:
    points = torch.rand(3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: annealed_fourier_features(x, 4, 2.3), (points,))
