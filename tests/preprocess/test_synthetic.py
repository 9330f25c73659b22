from actorsnerf_preprocess import synthetic


def test_the_front_door_has_both_writers_and_their_options() -> None:
    assert synthetic.PRESETS["small"] == synthetic.SyntheticOptions(cameras=4, size=320)
    assert callable(synthetic.write_zju_tree) and callable(synthetic.write_aist_tree)
