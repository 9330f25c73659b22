"""One synthetic actor written as every tree, prepared, and compared with the classic one."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess import synthetic_zju
from actorsnerf_preprocess.__main__ import main
from actorsnerf_preprocess.free_body import free_body_path
from actorsnerf_preprocess.renderer import MeshRenderer
from actorsnerf_preprocess.shots import take as draw
from actorsnerf_preprocess.stage import SyntheticOptions, performances
from actorsnerf_preprocess.synthetic_zju import write_zju_tree
from actorsnerf_preprocess.zju_layouts import LAYOUTS, TreeVariant

OPTIONS = SyntheticOptions(
    actors=0, held_out=1, frames=3, cameras=2, size=112, texture=32, full=True
)
CONVERTED: tuple[TreeVariant, ...] = ("converted-humannerf", "converted-actorsnerf")
NAMES: dict[TreeVariant, str] = {
    "classic-23": "CoreView_heldout00",
    "classic-21": "CoreView_heldout00",
    "renamed-21": "CoreView_heldout00",
    "refined": "my_heldout00",
    "easymocap": "heldout00",
    "converted-humannerf": "heldout00",
    "converted-actorsnerf": "heldout00",
}
Prepared = dict[TreeVariant, Path]
FLOAT32 = 1e-6
"""Metres: what float32 leaves of joints and translations, and of vertices, even if they are rebuilt
with betas that were found from rest joints."""


@pytest.fixture(scope="module")
def trees(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """All variants in folders of their names. Equal drawings are made once."""
    root = tmp_path_factory.mktemp("variants")
    shots: dict[bytes, Any] = {}
    danced: dict[SyntheticOptions, Any] = {}

    def take(renderer: MeshRenderer, meshes: Any, rig: Any, lighting: Any) -> Any:
        pinhole = rig.lens.pinhole
        numbers = [*(mesh.vertices for mesh in meshes), pinhole.K, pinhole.R, pinhole.T]
        key = b"".join(np.ascontiguousarray(each).tobytes() for each in numbers)
        if key not in shots:
            shots[key] = draw(renderer, meshes, rig, lighting)
        return shots[key]

    def dance(options: SyntheticOptions, *others: Any) -> Any:
        key = replace(options, variant="classic-23")
        if key not in danced:
            danced[key] = list(performances(options, *others))
        return danced[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(synthetic_zju, "take", take)
        patch.setattr(synthetic_zju, "performances", dance)
        for variant in NAMES:
            write_zju_tree(root / variant, replace(OPTIONS, variant=variant))
    assert len(shots) == OPTIONS.frames * OPTIONS.cameras
    yield root


@pytest.fixture(scope="module")
def prepared(trees: Path, tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    """The file of each variant, as the command makes it."""
    out = tmp_path_factory.mktemp("prepared")
    files: Prepared = {}
    for variant, name in NAMES.items():
        command = ["prepare", "--source", str(trees / variant), "--out", str(out / variant)]
        assert main([*command, "--workers", "1", "--scale", "1", "--all-pairs"]) == 0
        files[variant] = out / variant / f"{name}.h5"
    return files


def world_vertices(file: SequenceFile, frame: int) -> Float64:
    matrix = file.header.fits.world_from_body[frame]
    world: Float64 = file.posed_vertices(frame) @ matrix[:3, :3].T + matrix[:3, 3]
    return world


@pytest.mark.parametrize("variant", [name for name in LAYOUTS if name != "classic-23"])
def test_a_raw_tree_gives_the_file_of_the_classic_one(
    variant: TreeVariant, prepared: Prepared
) -> None:
    """Exactly: the same pictures, byte by byte, and the same numbers to float64's rounding."""
    with SequenceFile(prepared["classic-23"]) as classic, SequenceFile(prepared[variant]) as other:
        a, b = classic.complete_header(), other.complete_header()
        first = LAYOUTS[variant].first
        assert b.actor == a.actor == "heldout00"
        assert (b.frames - first).tolist() == a.frames.tolist() == list(range(OPTIONS.frames))
        np.testing.assert_allclose(b.world_up, a.world_up, atol=1e-12)
        for one, two in zip(a.cameras, b.cameras, strict=True):
            assert two.size == one.size
            for key in ("K", "R", "T", "source_K", "source_distortion"):
                np.testing.assert_allclose(getattr(two, key), getattr(one, key), atol=1e-12)
        for key in vars(a.fits):
            np.testing.assert_allclose(
                getattr(b.fits, key), getattr(a.fits, key), atol=1e-12, err_msg=key
            )
        for key in vars(a.shape):
            np.testing.assert_allclose(getattr(b.shape, key), getattr(a.shape, key), atol=1e-12)
        assert other.valid.all() and classic.valid.all()
        for camera in range(OPTIONS.cameras):
            for frame in range(OPTIONS.frames):
                p, q = classic.picture(camera, frame), other.picture(camera, frame)
                np.testing.assert_array_equal(q.rgb, p.rgb)
                np.testing.assert_array_equal(q.alpha, p.alpha)
                assert q.offset == p.offset


@pytest.mark.parametrize("variant", CONVERTED)
def test_a_converted_tree_gives_the_classic_one_to_the_accuracy_of_its_numbers(
    variant: TreeVariant, prepared: Prepared
) -> None:
    """Pictures are the raw ones; cameras, fits and rest joints were rounded to float32."""
    with SequenceFile(prepared["classic-23"]) as classic, SequenceFile(prepared[variant]) as other:
        a, b = classic.header, other.header
        assert len(b.cameras) == (1 if variant == "converted-humannerf" else 2)
        assert b.actor == a.actor
        for one, two in zip(a.cameras, b.cameras, strict=False):
            np.testing.assert_allclose(two.K, one.K, atol=1e-5)
            np.testing.assert_allclose(two.R, one.R, atol=1e-12)
            np.testing.assert_allclose(two.T, one.T, atol=1e-12)
            np.testing.assert_allclose(two.source_distortion, one.source_distortion, atol=1e-7)
        np.testing.assert_allclose(b.fits.body_pose, a.fits.body_pose, atol=1e-6)
        for key in ("world_from_body", "posed_joints", "rest_joints"):
            np.testing.assert_allclose(
                getattr(b.fits, key), getattr(a.fits, key), atol=FLOAT32, err_msg=key
            )
        for frame in range(OPTIONS.frames):
            moved = np.abs(world_vertices(other, frame) - world_vertices(classic, frame)).max()
            assert moved < FLOAT32
            for camera in range(len(b.cameras)):
                p, q = (f.full_alpha(camera, frame) for f in (classic, other))
                both, either = (p > 0.5) & (q > 0.5), (p > 0.5) | (q > 0.5)
                assert both.sum() / either.sum() > 0.999
                assert np.abs(p - q).max() <= 1 / 255 + 1e-6
                black = (0.0, 0.0, 0.0)
                shown, found = (f.full_picture(camera, frame, black) for f in (classic, other))
                assert np.abs(shown - found).max() <= 1 / 255 + 1e-6
                assert np.mean(shown != found) < 1e-3


def test_a_single_camera_knows_up_to_its_own_tilt(prepared: Prepared) -> None:
    with (
        SequenceFile(prepared["classic-23"]) as classic,
        SequenceFile(prepared["converted-humannerf"]) as alone,
    ):
        cosine = float(classic.header.world_up @ alone.header.world_up)
        assert 1 < np.degrees(np.arccos(cosine)) < 12
        assert "off by that camera's tilt" in " ".join(alone.header.provenance.notes)


@pytest.mark.parametrize("variant", list(NAMES))
def test_every_file_passes_its_check_and_says_that_it_is_synthetic(
    variant: TreeVariant, prepared: Prepared
) -> None:
    findings = check_sequence(prepared[variant], free_body_path())
    assert [each.sentence for each in findings if each.severity != "note"] == []
    with SequenceFile(prepared[variant]) as file:
        provenance = file.header.provenance
        assert provenance.dataset == "synthetic"
        assert provenance.source_terms.startswith("redistribution = allowed")
        assert ("converted" in provenance.variant) == (variant in CONVERTED)
        (protocol,) = file.header.protocols
        assert (protocol.name, protocol.role) == ("generic", "held_out")
        assert protocol.training_camera == file.header.cameras[0].name


def test_what_is_only_in_some_trees(trees: Path) -> None:
    folders = {
        variant: {path.name for path in (trees / variant / name).iterdir()}
        for variant, name in NAMES.items()
    }
    fits = {"params", "vertices", "new_params", "new_vertices", "smpl_params", "smpl_vertices"}
    assert {variant: names & fits for variant, names in folders.items()} == {
        "classic-23": {"params", "vertices", "new_params", "new_vertices"},
        "classic-21": {"params", "vertices", "new_params", "new_vertices"},
        "renamed-21": {"params", "vertices"},
        "refined": {"smpl_params", "smpl_vertices"},
        "easymocap": {"params", "vertices"},
        "converted-humannerf": set(),
        "converted-actorsnerf": {"new_vertices"},
    }
    assert folders["converted-actorsnerf"] == {"0", "1", "new_vertices", "lbs"}
