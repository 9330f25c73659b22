import pickle
import re
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from actorsnerf_datasets.cameras import camera_centre
from actorsnerf_datasets.published import AIST_SEQUENCES
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_preprocess import aist_reader
from actorsnerf_preprocess.aist import (
    dance_protocol,
    find_aist,
    needed_cameras,
    open_aist,
    protocol_findings,
    survey_aist,
)
from actorsnerf_preprocess.aist_checks import SMPL_OF_COCO
from actorsnerf_preprocess.aist_reader import AistReader
from actorsnerf_preprocess.backgrounds import Background, estimate_background
from actorsnerf_preprocess.prepare import PrepareOptions, prepare_sequence
from actorsnerf_preprocess.source import OpenOptions, SourceError
from actorsnerf_preprocess.workers import load_job

POSES = ("smpl_poses", "smpl_trans")


def rewritten(tree: Any, **changes: Any) -> None:
    path = tree.root / "annotations" / "motions" / f"{tree.name}.pkl"
    path.write_bytes(pickle.dumps(pickle.loads(path.read_bytes()) | changes))


def renamed(tree: Any, sequence: str) -> None:
    """The tree's only dance under another name."""
    annotations = tree.root / "annotations"
    motion = annotations / "motions" / f"{tree.name}.pkl"
    motion.rename(motion.with_name(f"{sequence}.pkl"))
    (annotations / "cameras" / "mapping.txt").write_text(f"{sequence} setting7_1")
    for camera in tree.names:
        old, new = (name.replace("cAll", camera) for name in (tree.name, sequence))
        (tree.root / "videos" / f"{old}.mp4").rename(tree.root / "videos" / f"{new}.mp4")


def test_a_raw_tree_is_found_opened_and_right(aist: Any) -> None:
    (found,) = find_aist(aist.root)
    assert (found.name, found.dataset) == (aist.name, "aist++")
    source = open_aist(found, OpenOptions(body_model=aist.body, pairs="all"))
    assert source.actor == "d31" and source.body_model == "smpl male"
    assert source.world_up.tolist() == [0, 1, 0]
    assert [camera.name for camera in source.cameras] == list(aist.names)
    for camera, centre in zip(source.cameras, aist.centres, strict=True):
        np.testing.assert_allclose(camera_centre(camera.R, camera.T), centre, atol=1e-9)
    matrix = source.fits.world_from_body
    world = source.fits.posed_vertices @ np.swapaxes(matrix[:, :3, :3], 1, 2)
    world += matrix[:, None, :3, 3]
    np.testing.assert_allclose(world, aist.world_vertices, atol=1e-6)
    assert source.wanted.all() and source.wanted.shape == (3, 8)


def test_a_prepared_file_holds_what_was_photographed(aist: Any, tmp_path: Path) -> None:
    source = open_aist(
        find_aist(aist.root)[0],
        OpenOptions(body_model=aist.body, pairs="all", masks=aist.masks),
    )
    (tmp_path / "out").mkdir()
    prepare_sequence(source, tmp_path / "out", PrepareOptions())
    with SequenceFile(tmp_path / "out" / f"{aist.name}.h5") as prepared:
        header = prepared.header
        assert header.provenance.dataset == "aist++"
        assert header.provenance.mask_source == "given by the user"
        assert prepared.valid.all()
        picture = prepared.picture(1, 4)
        person = picture.alpha == 255
        # The dancer is drawn in one colour, RGB 220, 60, 40; thin limbs are blurred by the video.
        np.testing.assert_allclose(np.median(picture.rgb[person], 0), [220, 60, 40], atol=15)


class Forgetful(Executor):
    """Runs each task at once, and as if in a new process: nothing is remembered between tasks."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        load_job.cache_clear()
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_stages_are_estimated_once_per_view_for_all_processes(
    aist: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = open_aist(find_aist(aist.root)[0], OpenOptions(body_model=aist.body, pairs="all"))
    estimated: list[int] = []

    def counted(samples: Any) -> Background:
        estimated.append(len(samples))
        return estimate_background(samples)

    monkeypatch.setattr(aist_reader, "estimate_background", counted)
    monkeypatch.setattr(AistReader, "frames_per_task", 3)
    files = []
    for name, executor in (("one", None), ("many", Forgetful())):
        out = tmp_path / name
        out.mkdir()
        leftover = out / f"{aist.name}.job.part.stage2.npz"
        leftover.write_bytes(b"of a run that was killed")
        prepare_sequence(source, out, PrepareOptions(contact_sheet=False), executor)
        assert sorted(path.suffix for path in out.iterdir()) == [".h5", ".json"]
        assert len(estimated) == 3
        estimated.clear()
        files.append((out / f"{aist.name}.h5").read_bytes())
    assert files[0] == files[1]


def test_only_what_the_protocol_uses_is_wanted(aist: Any) -> None:
    (found,) = find_aist(aist.root)
    source = open_aist(found, OpenOptions(body_model=aist.body))
    (protocol,) = source.protocols
    assert (protocol.name, protocol.role) == ("generic", "pretraining")
    assert source.wanted[0].all() and not source.wanted[1:].any()
    held_out = open_aist(found, OpenOptions(body_model=aist.body, held_out=("d31",)))
    assert held_out.protocols[0].role == "held_out"


def test_the_papers_sequences_have_the_papers_protocol(write_aist: Any, tmp_path: Path) -> None:
    tree = write_aist(tmp_path, cameras=1, frames=2, size=(64, 36))
    official = "gJS_sFM_cAll_d01_mJS5_ch06"
    path = tree.root / "annotations" / "motions" / f"{tree.name}.pkl"
    motion = pickle.loads(path.read_bytes())
    longer = {key: np.resize(motion[key], (440, motion[key].shape[1])) for key in POSES}
    path.with_name(f"{official}.pkl").write_bytes(pickle.dumps(motion | longer))
    path.unlink()
    (tree.root / "annotations" / "cameras" / "mapping.txt").write_text(f"{official} setting7_1")
    video = tree.root / "videos" / f"{official.replace('cAll', 'c01')}.mp4"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"mp4v"), 60.0, (64, 36))
    for _ in range(440):
        writer.write(np.zeros((36, 64, 3), np.uint8))
    writer.release()
    (found,) = find_aist(tree.root)
    source = open_aist(found, OpenOptions(body_model=tree.body))
    assert source.frames.tolist() == list(range(200, 440, 4))
    (protocol,) = source.protocols
    assert (protocol.name, protocol.role) == ("actorsnerf-aist", "pretraining")
    assert source.wanted.all()
    every = open_aist(found, OpenOptions(body_model=tree.body, pairs="all"))
    assert every.frames.tolist() == list(range(440))
    assert every.wanted.all() and every.protocols == source.protocols


def test_any_dance_of_a_test_dancer_is_held_out_and_said(aist: Any) -> None:
    other = "gLH_sBM_cAll_d16_mLH0_ch01"
    renamed(aist, other)
    (found,) = find_aist(aist.root)
    source = open_aist(found, OpenOptions(body_model=aist.body))
    (protocol,) = source.protocols
    assert (source.actor, protocol.name, protocol.role) == ("d16", "generic", "held_out")
    (warning,) = (finding for finding in source.findings if finding.entry == "protocol")
    assert warning.severity == "warning"
    assert "held out, its 8 frames give no few-shot list" in warning.sentence
    assert "the published lists are for gLH_sFM_cAll_d16_mLH2_ch03." in warning.sentence
    assert warning.sentence in source.notes
    assert warning in survey_aist(found, OpenOptions()).findings


@pytest.mark.parametrize(
    ("cameras", "last", "reason"),
    [
        (["c02", "c03"], 2400, "with generic lists: .* camera c01, which has no usable video"),
        (["c01", "c02"], 1300, "beyond 1400; there are c01, c02, and frames 200 to 1296"),
        (["c01"], 2400, "there are c01, and frames"),
    ],
)
def test_a_test_dancer_is_held_out_also_without_what_its_protocol_needs(
    cameras: list[str], last: int, reason: str
) -> None:
    sequence, frames = "gLH_sFM_cAll_d16_mLH2_ch03", np.arange(200, last, 4)
    protocol = dance_protocol(sequence, OpenOptions(), cameras, frames)
    assert (protocol.name, protocol.role) == ("generic", "held_out")
    (finding,) = protocol_findings(sequence, protocol, cameras, frames)
    assert re.search(reason, finding.sentence)
    official = dance_protocol(sequence, OpenOptions(), ["c01", "c02"], np.arange(200, 2400, 4))
    assert official.name == "actorsnerf-aist"
    assert protocol_findings(sequence, official, ["c01", "c02"], frames) == ()


@pytest.mark.parametrize("by_sequence", [False, True])
def test_a_published_dancer_is_held_out_where_the_user_says_so(by_sequence: bool) -> None:
    sequence, frames = AIST_SEQUENCES["d01"], np.arange(200, 2400, 4)
    options = OpenOptions(held_out=(sequence if by_sequence else "d01",))
    protocol = dance_protocol(sequence, options, ["c01", "c02"], frames)
    assert (protocol.name, protocol.role) == ("generic", "held_out")
    assert protocol.shots
    published = dance_protocol(sequence, OpenOptions(), ["c01", "c02"], frames)
    assert (published.name, published.role) == ("actorsnerf-aist", "pretraining")


def test_the_survey_needs_no_body_model(aist: Any) -> None:
    facts = dict(survey_aist(find_aist(aist.root)[0], OpenOptions()).facts)
    assert facts["views"] == "c01, c02, c03"
    assert facts["picture size"] == "192 x 108"
    assert facts["camera setting"] == "setting7_1"
    assert facts["scaling"] == "93.000 world units per metre"
    assert facts["frames"] == "8: 0 to 7"


def test_no_body_model_says_which_where_and_how(aist: Any) -> None:
    (found,) = find_aist(aist.root)
    with pytest.raises(SourceError, match="SMPL's male model") as refusal:
        open_aist(found, OpenOptions())
    assert "https://smpl.is.tue.mpg.de" in str(refusal.value)
    assert "--body-model" in str(refusal.value)


def test_another_than_the_male_model_is_a_warning(aist: Any, tiny_body: Path) -> None:
    source = open_aist(find_aist(aist.root)[0], OpenOptions(body_model=tiny_body))
    assert any("is not SMPL's male model by its name" in each.sentence for each in source.findings)
    assert source.body_model == "tiny_neutral"


def test_a_synthetic_tree_has_the_free_body(aist: Any) -> None:
    (aist.root / "synthetic.json").write_text("{}")
    (found,) = find_aist(aist.root)
    assert found.dataset == "synthetic"
    source = open_aist(found, OpenOptions())
    assert source.body_model == "cc0 body" and source.fits.posed_vertices.shape[1] > 10000
    assert source.source_terms.startswith("redistribution = allowed")


def test_units_that_do_not_agree_are_refused(aist: Any) -> None:
    rewritten(aist, smpl_scaling=np.array([0.93]))
    with pytest.raises(SourceError, match="motion and cameras are in different units"):
        open_aist(find_aist(aist.root)[0], OpenOptions(body_model=aist.body))


def test_keypoints_are_compared_where_they_are_there(aist: Any) -> None:
    folder = aist.root / "annotations" / "keypoints3d"
    folder.mkdir()
    points = np.full((8, 17, 3), np.nan)
    for coco, smpl in SMPL_OF_COCO:
        mirrored = smpl + (1 if smpl % 2 else -1) if smpl < 12 else smpl + (-1 if smpl % 2 else 1)
        points[:, coco] = aist.scaling * aist.world_joints[:, mirrored]
    content = {"keypoints3d": points, "keypoints3d_optim": points}
    (folder / f"{aist.name}.pkl").write_bytes(pickle.dumps(content))
    source = open_aist(find_aist(aist.root)[0], OpenOptions(body_model=aist.body))
    assert any("left and right of the body are swapped" in f.sentence for f in source.findings)


def test_motions_without_videos_are_refused_with_where_to_get_them(aist: Any) -> None:
    for path in (aist.root / "videos").iterdir():
        path.unlink()
    with pytest.raises(SourceError, match="1 motions but none of their videos") as refusal:
        find_aist(aist.root)
    assert "https://aistdancedb.ongaaccel.jp" in str(refusal.value)


def test_a_folder_of_something_else_holds_nothing(tmp_path: Path) -> None:
    assert find_aist(tmp_path) == ()


def test_a_sequence_that_is_not_there_is_named(aist: Any) -> None:
    (found,) = find_aist(aist.root)
    with pytest.raises(SourceError, match=r"gXX\.pkl: there is no such file"):
        open_aist(replace(found, name="gXX"), OpenOptions(body_model=aist.body))


def test_absent_views_matter_only_to_whom_they_are_needed(tmp_path: Path, write_aist: Any) -> None:
    tree = write_aist(tmp_path, frames=12, cameras=3)
    (found,) = find_aist(tree.root)
    for camera in ("c02", "c03"):
        (tree.root / "videos" / f"{tree.name.replace('cAll', camera)}.mp4").unlink()
    for held_out, severity in (((), "note"), (("d31",), "warning")):
        options = OpenOptions(body_model=tree.body, held_out=held_out)
        for findings in (open_aist(found, options).findings, survey_aist(found, options).findings):
            assert {f.entry: f.severity for f in findings if f.entry in ("c02", "c03")} == {
                "c02": severity,
                "c03": severity,
            }
    facts = dict(survey_aist(found, OpenOptions()).facts)
    assert facts["protocol"] == "generic, pretraining: needs c01"
    assert needed_cameras(tree.name, OpenOptions(pairs="all"), np.arange(12))[-1] == "c08"
