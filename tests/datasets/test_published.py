from actorsnerf_datasets.published import (
    AIST_EXTRA,
    AIST_FIVE_SHOT,
    AIST_SEQUENCES,
    AIST_SUPPORT,
    FEWSHOT_SKIPS,
    ZJU_PRETRAINING,
    ZJU_SUPPORT,
)


def test_thirty_dancers_and_five_held_out() -> None:
    assert list(AIST_SEQUENCES) == [f"d{number:02d}" for number in range(1, 31)]
    assert all(f"_{dancer}_" in name for dancer, name in AIST_SEQUENCES.items())
    held_out = ["d16", "d17", "d18", "d19", "d20"]
    assert list(AIST_FIVE_SHOT) == list(AIST_EXTRA) == list(AIST_SUPPORT) == held_out


def test_the_aist_lists_are_on_the_grid_of_the_pool() -> None:
    for table in (AIST_FIVE_SHOT, AIST_EXTRA, AIST_SUPPORT):
        for frames in table.values():
            assert all(200 <= frame <= 1396 and frame % 4 == 0 for frame in frames)
    for dancer, support in AIST_SUPPORT.items():
        assert set(support) <= set(AIST_FIVE_SHOT[dancer])


def test_zju_supports_are_among_their_frames() -> None:
    assert set(ZJU_PRETRAINING) & set(ZJU_SUPPORT) == set()
    for by_count in ZJU_SUPPORT.values():
        assert set(by_count[5]) <= {0, 75, 150, 225, 300}
        for count, skip in FEWSHOT_SKIPS.items():
            assert count == 300 // skip
            assert set(by_count[count]) <= set(range(skip, 301, skip))
