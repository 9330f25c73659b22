import pytest

from actorsnerf_preprocess import synthetic
from actorsnerf_preprocess.synthetic_aist import write_aist_tree
from actorsnerf_preprocess.synthetic_zju import write_zju_tree


def test_both_formats_and_the_sizes_are_named() -> None:
    assert synthetic.write_aist_tree is write_aist_tree
    assert synthetic.write_zju_tree is write_zju_tree
    assert "tiny" in synthetic.PRESETS


@pytest.mark.parametrize("preset", synthetic.PRESETS.values(), ids=list(synthetic.PRESETS))
def test_every_preset_has_held_out_actors_and_other_cameras(
    preset: synthetic.SyntheticOptions,
) -> None:
    assert preset.held_out >= 1
    assert 2 <= preset.cameras <= 9
    assert preset.actors >= 2
