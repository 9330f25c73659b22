from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.renderer import MeshRenderer
from actorsnerf_preprocess.shots import Rig
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.stage import (
    HELD_OUT,
    PRESETS,
    SIGN,
    TRUTH,
    Performance,
    Recording,
    SyntheticOptions,
    claim,
    is_finished,
    keep_facts,
    performances,
    require_sensible,
    ring,
    sign_finished,
)
from actorsnerf_preprocess.synthetic_aist import hall_rigs
from actorsnerf_preprocess.synthetic_zju import studio_rigs

FEW = SyntheticOptions(actors=2, held_out=1, frames=4, texture=64)


def played(options: SyntheticOptions, recording: Recording) -> list[Performance]:
    with MeshRenderer() as renderer:
        return list(performances(options, renderer, recording))


def facing(performance: Performance) -> Float64:
    """(F, 3) where the front of the body points."""
    poses = [performance.pose(frame) for frame in range(performance.motion.frame_count)]
    return np.stack([pose.world_from_body[:3, 2] for pose in poses])


def test_the_ring_looks_at_the_dancer_from_all_sides() -> None:
    cameras = ring(8, 3.0, 1.3, 500.0, (512, 480))
    centres = np.stack([-camera.R.T @ camera.T for camera in cameras])
    np.testing.assert_allclose(np.hypot(centres[:, 0], centres[:, 2]), 3.0)
    np.testing.assert_allclose(centres[0], [0, 1.3, 3.0], atol=1e-12)
    np.testing.assert_allclose(centres[:, 1], [1.3, 1.55] * 4)
    for camera in cameras:
        np.testing.assert_allclose(camera.R @ camera.R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.R) == pytest.approx(1.0)
        waist = camera.R @ [0, 0.9, 0] + camera.T
        assert np.abs(waist[:2]).max() < 1e-12 and waist[2] > 2.9
        # Image y runs down.
        assert camera.R[1] @ [0, 1, 0] < -0.9


@pytest.mark.parametrize("rigs", [studio_rigs, hall_rigs])
def test_a_zoom_lengthens_every_lens(rigs: Callable[[SyntheticOptions], tuple[Rig, ...]]) -> None:
    for plain, close in zip(rigs(FEW), rigs(replace(FEW, zoom=1.5)), strict=True):
        before, after = plain.lens.pinhole, close.lens.pinhole
        np.testing.assert_allclose(after.K[[0, 1], [0, 1]], 1.5 * before.K[[0, 1], [0, 1]])
        np.testing.assert_array_equal(after.K[:2, 2], before.K[:2, 2])
        np.testing.assert_array_equal(after.T, before.T)
        assert after.size == before.size


def test_the_seed_decides_everybody() -> None:
    first, again, other = (
        played(options, Recording(15.0)) for options in (FEW, FEW, replace(FEW, seed=1))
    )
    assert [each.name for each in first] == ["actor00", "actor01", "heldout00"]
    assert [each.role for each in first] == ["pretraining", "pretraining", "held_out"]
    for one, two, three in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(one.motion.poses, two.motion.poses)
        np.testing.assert_array_equal(one.dressed.actor.betas, two.dressed.actor.betas)
        assert np.abs(one.motion.poses - three.motion.poses).max() > 0.1
        assert one.dressed.actor.outfit == two.dressed.actor.outfit
    assert len({each.dance for each in first}) == 3


def test_the_held_out_actor_faces_camera_one_at_first_and_turns_round_later() -> None:
    *_, held_out = played(replace(FEW, actors=0, frames=60), Recording(15.0))
    front = facing(held_out)[:, 2]
    assert front[:12].min() > 0.9
    assert front[:36].min() < -0.9


def test_a_stride_slows_the_turning_but_not_the_dance() -> None:
    one = replace(FEW, actors=1, held_out=0, frames=8)
    plain = played(one, Recording(15.0))[0]
    slow = played(replace(one, frames=32), Recording(60.0, stride=4))[0]
    np.testing.assert_allclose(slow.motion.poses[::4], plain.motion.poses, atol=1e-9)
    np.testing.assert_allclose(facing(slow)[::4], facing(plain), atol=1e-6)


def test_one_shape_if_the_data_set_knows_only_one() -> None:
    for performance in played(FEW, Recording(15.0, shaped=False)):
        assert not performance.dressed.actor.betas.any()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (replace(FEW, frames=1), "--frames 1: expected 2 or more"),
        (replace(FEW, cameras=0), "--cameras 0: expected 1 or more"),
        (replace(FEW, held_out=-1), "--held-out -1: expected 0 or more"),
        (replace(FEW, size=3), "--size 3: expected 32 or more"),
        (replace(FEW, zoom=0.0), "--zoom 0.0: expected a factor from 0.1 to 10"),
        (replace(FEW, zoom=float("nan")), "--zoom nan: expected a factor"),
        (replace(FEW, actors=0, held_out=0), "nobody is left to draw"),
        (replace(FEW, cameras=10), "--cameras 10: an AIST.. tree has 9 cameras at most"),
    ],
)
def test_numbers_that_make_no_data_set_are_refused(
    options: SyntheticOptions, sentence: str
) -> None:
    with pytest.raises(SourceError, match=sentence):
        require_sensible(options, 9, "an AIST++")


def test_a_tree_of_one_camera_ignores_the_others() -> None:
    require_sensible(replace(FEW, cameras=10), 1, "a converted-humannerf")


def test_a_foreign_folder_is_not_written_into(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(SourceError, match=f"not empty and no synthetic data set .*{SIGN}"):
        claim(tmp_path, "AIST++", FEW)
    with pytest.raises(SourceError, match="name another"):
        claim(tmp_path / "holiday.jpg", "AIST++", FEW)
    assert [path.name for path in tmp_path.iterdir()] == ["holiday.jpg"]


def test_a_tree_is_signed_when_it_is_finished(tmp_path: Path) -> None:
    root = tmp_path / "new" / "folder"
    assert claim(root, "AIST++", FEW)
    assert not (root / SIGN).exists()
    assert claim(root, "AIST++", FEW), "an unfinished tree is gone on with"
    assert not is_finished(root, "aunt")
    keep_facts(root, "aunt", {"role": "pretraining"})
    assert is_finished(root, "aunt")
    sign_finished(root, ["uncle"])
    assert not claim(root, "AIST++", FEW), "nothing is left to do"
    assert sorted(path.name for path in root.iterdir()) == [HELD_OUT, SIGN, TRUTH]
    assert (root / HELD_OUT).read_text() == "uncle\n"


def test_other_options_need_another_folder(tmp_path: Path) -> None:
    claim(tmp_path, "AIST++", FEW)
    for form, options in (("ZJU-MoCap", FEW), ("AIST++", replace(FEW, seed=1))):
        with pytest.raises(SourceError, match="a synthetic data set of other options; name"):
            claim(tmp_path, form, options)


def test_finished_actors_are_passed_over() -> None:
    with MeshRenderer() as renderer:
        left = list(performances(FEW, renderer, Recording(15.0), lambda position: position != 2))
    assert [(each.position, each.name) for each in left] == [(2, "heldout00")]
    whole = played(FEW, Recording(15.0))[2]
    np.testing.assert_array_equal(left[0].motion.poses, whole.motion.poses)


def test_presets_leave_room_for_the_protocol() -> None:
    assert PRESETS["evaluation"].frames >= 550
    assert all(preset.held_out >= 1 and preset.cameras >= 2 for preset in PRESETS.values())
