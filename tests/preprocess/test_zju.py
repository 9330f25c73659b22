from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actorsnerf_datasets.cameras import camera_from_world, project_distorted
from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Float64
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, SourceError, SourceSequence
from actorsnerf_preprocess.zju import find_zju, open_zju, survey_zju
from actorsnerf_preprocess.zju_tree import Variant

WriteTree = Callable[..., Any]
VARIANTS: tuple[tuple[Variant, str, int], ...] = (
    ("classic-23", "CoreView_377", 0),
    ("classic-21", "CoreView_313", 1),
    ("renamed-21", "CoreView_315", 1),
    ("refined", "my_377", 0),
    ("easymocap", "aunt", 0),
)


def world_vertices(source: SourceSequence, frame: int) -> Float64:
    matrix = source.fits.world_from_body[frame]
    vertices = source.fits.posed_vertices[frame].astype(np.float64)
    world: Float64 = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return world


@pytest.mark.parametrize(("variant", "name", "first"), VARIANTS)
def test_every_variant_projects_the_annotated_vertices_to_a_hundredth_of_a_pixel(
    variant: Variant, name: str, first: int, tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / name, variant=variant, frames=range(first, first + 3))
    (found,) = find_zju(tmp_path)
    source = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    assert source.frames.tolist() == [first, first + 1, first + 2]
    assert [camera.name for camera in source.cameras] == list(tree.names)
    for index, camera in enumerate(source.cameras):
        for frame in range(3):
            ours = project_distorted(
                world_vertices(source, frame),
                camera.K,
                camera_from_world(camera.R, camera.T),
                camera.distortion,
            )
            # The annotation by hand: K, D, R, T / 1000 and the vertices as in the raw files.
            raw = tree.world_vertices[frame] @ tree.R[index].T + tree.T[index]
            theirs = project_distorted(raw, tree.K[index], np.eye(4), camera.distortion)
            assert np.abs(ours.pixels - theirs.pixels).max() < 0.01


@pytest.mark.parametrize(("variant", "name", "first"), VARIANTS)
def test_every_variant_is_prepared(
    variant: Variant, name: str, first: int, tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / name, variant=variant, frames=range(first, first + 3))
    (found,) = find_zju(tmp_path)
    source = open_zju(found, OpenOptions(body_model=tiny_body, pairs="all"))
    report = prepare_sequence(source, tmp_path, PrepareOptions())
    assert report is not None
    assert (report.stored, report.asked, report.unusable) == (9, 9, ())
    assert all(camera.inside is not None and camera.inside > 0.95 for camera in report.cameras)
    with SequenceFile(tmp_path / f"{name}.h5") as file:
        assert file.valid.all()
        assert file.header.provenance.dataset == "zju-mocap"
        assert "Camera translations are millimetres" in " ".join(file.header.provenance.notes)
        assert file.header.world_up @ [0, 0, -1] > 0.9995  # cameras of unequal heights


def test_only_the_pairs_of_the_protocol_are_wanted(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "CoreView_377")
    source = open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))
    assert source.wanted.tolist() == [[True] * 4, [False] * 4, [False] * 4]
    assert source.protocols[0].name == "actorsnerf-zju"


def test_pictures_that_the_protocol_does_not_need_may_be_absent(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "CoreView_377", frames=range(2))
    (found,) = find_zju(tmp_path)
    (tree.root / tree.names[1] / "000001.jpg").unlink()
    protocol = OpenOptions(body_model=tiny_body)
    for options, severity in ((protocol, "note"), (replace(protocol, pairs="all"), "warning")):
        findings = {f.entry: f.severity for f in open_zju(found, options).findings}
        assert findings["pictures"] == severity


def test_an_actor_outside_the_lists_is_held_out_when_named(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "aunt", variant="easymocap", frames=range(20))
    (found,) = find_zju(tmp_path)
    for held_out, role in (((), "pretraining"), (("aunt",), "held_out")):
        source = open_zju(found, OpenOptions(body_model=tiny_body, held_out=held_out))
        assert source.protocols[0].role == role
        assert f"counts as {role}" in " ".join(source.notes)


def test_a_published_test_actor_of_one_camera_is_held_out_and_said(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    write_zju(tmp_path / "CoreView_387", cameras=1)
    (found,) = find_zju(tmp_path)
    source = open_zju(found, OpenOptions(body_model=tiny_body))
    (protocol,) = source.protocols
    assert (protocol.role, protocol.shots) == ("held_out", ())
    for findings in (source.findings, survey_zju(found, OpenOptions()).findings):
        (warning,) = (finding for finding in findings if finding.entry == "protocol")
        assert warning.severity == "warning"
        assert "zju-387 is a test actor of the published experiments" in warning.sentence
        assert "its 4 frames give no few-shot list" in warning.sentence
    assert warning.sentence in source.notes
    prepare_sequence(source, tmp_path, PrepareOptions())
    assert not [
        f for f in check_sequence(tmp_path / "CoreView_387.h5", None) if f.severity == "error"
    ]


def test_a_missing_body_model_is_answered_with_where_to_get_it(
    tmp_path: Path, write_zju: WriteTree
) -> None:
    write_zju(tmp_path / "CoreView_377")
    with pytest.raises(SourceError, match=r"register at .*smplify.*--body-model"):
        open_zju(find_zju(tmp_path)[0], OpenOptions())


def test_cameras_in_another_unit_than_the_fits_are_refused(
    tmp_path: Path, write_zju: WriteTree, tiny_body: Path
) -> None:
    tree = write_zju(tmp_path / "CoreView_377")
    for path in (tree.root / "new_params").iterdir():
        fit = np.load(path, allow_pickle=True).item()
        np.save(path, np.asarray({**fit, "Th": fit["Th"] + 100.0}), allow_pickle=True)
    for path in (tree.root / "new_vertices").iterdir():
        np.save(path, np.load(path) + 100.0)
    with pytest.raises(SourceError, match=r"Camera_B1: the person is 17\d m from the camera"):
        open_zju(find_zju(tmp_path)[0], OpenOptions(body_model=tiny_body))


def test_a_synthetic_tree_is_marked(tmp_path: Path, write_zju: WriteTree, tiny_body: Path) -> None:
    write_zju(tmp_path / "CoreView_387")
    (tmp_path / "synthetic.json").write_text("{}")
    (found,) = find_zju(tmp_path)
    assert found.dataset == "synthetic"
    source = open_zju(found, OpenOptions(body_model=tiny_body))
    assert source.actor == "387"
    assert "redistribution = allowed" in source.source_terms


def test_two_sequences_of_one_name_are_refused(tmp_path: Path, write_zju: WriteTree) -> None:
    for folder in ("a", "b"):
        write_zju(tmp_path / folder / "CoreView_377", frames=range(1))
    with pytest.raises(SourceError, match="two sequences are called CoreView_377"):
        find_zju(tmp_path)


def test_the_survey_needs_no_body_model(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377")
    (tree.root / tree.names[1] / "000002.jpg").unlink()
    survey = survey_zju(find_zju(tmp_path)[0], OpenOptions())
    facts = dict(survey.facts)
    assert facts["pictures"] == "11 of 12 listed are there"
    assert facts["cameras"] == "3: Camera_B1, Camera_B2, Camera_B3"
    sentences = [finding.sentence for finding in survey.findings]
    assert "1 of 12 listed pictures are missing: Camera_B2 1; frames 2." in sentences


def test_the_survey_says_what_the_protocol_lacks(tmp_path: Path, write_zju: WriteTree) -> None:
    tree = write_zju(tmp_path / "CoreView_377")
    (found,) = find_zju(tmp_path)
    missing = tree.root / tree.names[1] / "000002.jpg"
    for path, needed, severity in (
        (missing, "4 of 4 pictures that it needs are there", "note"),
        (tree.root / tree.names[0] / "000003.jpg", "3 of 4 pictures that it needs are", "warning"),
    ):
        path.unlink()
        survey = survey_zju(found, OpenOptions())
        assert needed in dict(survey.facts)["protocol"]
        assert {f.entry: f.severity for f in survey.findings}["pictures"] == severity
    every = dict(survey_zju(found, OpenOptions(pairs="all")).facts)["protocol"]
    assert every == "actorsnerf-zju, pretraining: 10 of 12 pictures are there; all are asked for"
