import torch

from actorsnerf_model.pieces import TILE, at_once, tiles


def test_pieces_fit_a_processors_cache_and_fill_an_accelerator() -> None:
    assert at_once(100, torch.device("cpu")) == 100
    assert at_once(100, torch.device("cuda", 1)) > 100
    assert at_once(100, torch.device("meta")) > 100


def test_tiles_cover_all_rows_once() -> None:
    rows = torch.arange(2 * TILE + 7)
    with torch.no_grad():
        parts = [rows[part] for part in tiles(rows)]
        assert [len(part) for part in parts] == [TILE, TILE, 7]
        assert torch.equal(torch.cat(parts), rows)
        assert [rows[:0][part].tolist() for part in tiles(rows[:0])] == [[]]
    assert [len(rows[part]) for part in tiles(rows)] == [len(rows)], "one gradient of the weights"
