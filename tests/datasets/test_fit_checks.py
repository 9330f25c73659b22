import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from actorsnerf_datasets import body_model
from actorsnerf_datasets.body_model import BodyModel
from actorsnerf_datasets.fit_checks import body_model_findings, fit_findings
from actorsnerf_datasets.types import ActorShape, BodyFits, Float64, SequenceHeader


def _changed(array: Float64, index: tuple[int, int], value: float) -> Float64:
    copy = array.copy()
    copy[index] = value
    return copy


def _with_fits(header: SequenceHeader, **changes: object) -> SequenceHeader:
    fits = dataclasses.replace(header.fits, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(header, fits=fits)


def test_good_fits_have_no_findings(header: SequenceHeader, body: BodyModel) -> None:
    assert list(fit_findings(header)) == []
    assert list(body_model_findings(header, body)) == []


CASES: list[tuple[str, Callable[[BodyFits], dict[str, object]], str]] = [
    (
        "fits/betas",
        lambda fits: {"betas": _changed(fits.betas, (2, 0), np.nan)},
        "has NaN or infinity in frames 102",
    ),
    (
        "fits/posed_joints",
        lambda fits: {"posed_joints": fits.posed_joints + 2e-5},
        "up to 2e-05 m from what the pose gives (at most 1e-05 is expected), in frames 100, 101",
    ),
    (
        "fits/posed_joints",
        lambda fits: {"body_pose": _changed(fits.body_pose, (3, 0), 1.0)},
        "in frames 103",
    ),
    (
        "fits/world_from_body",
        lambda fits: {"transl": _changed(fits.transl, (4, 0), 0.5)},
        "in frames 104",
    ),
    (
        "fits/posed_vertices",
        lambda fits: {"posed_vertices": fits.posed_vertices + np.float32(3)},
        "a joint lies 2.9",
    ),
]


@pytest.mark.parametrize(("entry", "change", "sentence"), CASES)
def test_each_fault_is_named(
    header: SequenceHeader,
    entry: str,
    change: Callable[[BodyFits], dict[str, object]],
    sentence: str,
) -> None:
    found = list(fit_findings(_with_fits(header, **change(header.fits))))
    assert [finding.entry for finding in found] == [entry]
    assert sentence in found[0].sentence
    assert found[0].severity == "error"


def test_half_a_turn_with_the_wrong_pelvis_is_found(header: SequenceHeader) -> None:
    """`Th` stored as `transl`: the fault of many converters."""
    wrong = header.fits.world_from_body[:, :3, 3]
    found = list(fit_findings(_with_fits(header, transl=wrong.copy())))
    assert [finding.entry for finding in found] == ["fits/world_from_body"]


def _with_shape(header: SequenceHeader, factor: float) -> SequenceHeader:
    shape = header.shape
    vertices = (shape.rest_vertices * factor).astype(np.float32)
    return dataclasses.replace(
        header, shape=ActorShape(shape.betas, shape.rest_joints * factor, vertices)
    )


def test_centimetres_and_another_actor_are_noticed(header: SequenceHeader) -> None:
    found = [f.sentence for f in fit_findings(_with_shape(header, 100))]
    assert any("the person is 175" in s and "are they metres, y up?" in s for s in found)
    found = [f"{f.severity} {f.sentence}" for f in fit_findings(_with_shape(header, 1.05))]
    assert len(found) == 1
    assert found[0].startswith("warning 0.0")
    assert "do actor and fits belong together" in found[0]


def test_up_is_a_unit_vector(header: SequenceHeader) -> None:
    found = list(fit_findings(dataclasses.replace(header, world_up=np.array([0.0, 2.0, 0.0]))))
    assert [f.sentence for f in found] == ["is no unit vector: [0.0, 2.0, 0.0]"]


def test_vertices_of_another_body_are_found(header: SequenceHeader, body: BodyModel) -> None:
    other = dataclasses.replace(body, template=body.template + 2e-3)
    found = {f.entry: f.sentence for f in body_model_findings(header, other)}
    assert set(found) == {"fits/posed_vertices", "actor/rest_vertices"}
    assert "at most 0.001 is expected" in found["fits/posed_vertices"]
    assert "0.002 m from the body model's" in found["actor/rest_vertices"]
    smaller = dataclasses.replace(body, template=body.template[:9])
    (finding,) = body_model_findings(header, smaller)
    assert finding.sentence.startswith("240 vertices, but the body model has 9")
    short = dataclasses.replace(body, shape_directions=body.shape_directions[..., :4])
    (finding,) = body_model_findings(header, short)
    assert finding.sentence.startswith("10 shape coefficients, but the body model has 4")


@pytest.mark.parametrize(("shift", "errors"), [(0.00055, 0), (0.0006, 1)])
def test_vertices_of_the_source_may_be_a_millimetre_off(
    header: SequenceHeader, body: BodyModel, shift: float, errors: int
) -> None:
    """In distance: three coordinates together."""
    moved = header.fits.posed_vertices.copy()
    moved[1, 7] += np.float32(shift)
    found = list(body_model_findings(_with_fits(header, posed_vertices=moved), body))
    assert [finding.severity for finding in found] == ["error"] * errors


def test_rest_vertices_come_from_the_model_itself(header: SequenceHeader, body: BodyModel) -> None:
    shape = header.shape
    moved = shape.rest_vertices + np.float32(2e-4)
    changed = dataclasses.replace(header, shape=ActorShape(shape.betas, shape.rest_joints, moved))
    (finding,) = body_model_findings(changed, body)
    assert (finding.entry, finding.severity) == ("actor/rest_vertices", "error")


def test_fits_without_pose_blend_shapes_are_noted(header: SequenceHeader, body: BodyModel) -> None:
    fits = header.fits
    pose = np.concatenate([np.zeros((len(header.frames), 1, 3)), fits.body_pose], axis=1)
    vertices = [
        body_model.pose(body, fits.betas[0], angles, pose_blend=False).vertices for angles in pose
    ]
    plain = _with_fits(header, posed_vertices=np.stack(vertices).astype(np.float32))
    found = [(f.severity, f.sentence) for f in body_model_findings(plain, body)]
    assert found == [("note", "posed without pose blend shapes")]
