import torch

from actorsnerf_model.pieces import at_once


def test_pieces_fit_a_processors_cache_and_fill_an_accelerator() -> None:
    assert at_once(100, torch.device("cpu")) == 100
    assert at_once(100, torch.device("cuda", 1)) > 100
    assert at_once(100, torch.device("meta")) > 100
