"""Hard cases of what comes in: a world far from its origin, and centimetres for metres."""

from dataclasses import replace

import numpy as np
import torch

from actorsnerf_datasets.camera_checks import camera_findings
from actorsnerf_datasets.cameras import camera_from_world
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.fit_checks import fit_findings
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_datasets.types import (
    ActorShape,
    BodyFits,
    Camera,
    Float64,
    Provenance,
    SequenceHeader,
)
from actorsnerf_train.invented_actor import camera_around, invented_actor
from actorsnerf_train.stability.case import Answer, Bounds, Case, Subject
from actorsnerf_train.stability.hard_poses import dance_poses

FAR = (1e4, 1e6)
"""Metres from the world's origin."""
REFUSED = Bounds(0.0, 0.0, 0.0)
FRAMES = 4
CENTIMETRES = 100.0


def input_cases() -> list[Case]:
    """The cases; all on an invented sequence, since they ask the checks, not the method."""
    cases = [_folded(metres) for metres in FAR]
    header = invented_header()
    cases.append(_refused("metres, as they should be", header, 0))
    for name, wrong in centimetre_headers(header).items():
        cases.append(_refused(f"centimetres as metres: {name}", wrong, 1))
    return cases


def _folded(metres: float) -> Case:
    """Camera and person moved far away together must look the same to the body frame."""

    def folded(away: float) -> Float64:
        header = invented_header()
        shift = np.array([away, -away, 0.5 * away])
        camera = header.cameras[0]
        moved = camera.T - camera.R @ shift
        fits = header.fits
        world = world_from_body(fits.global_orient, fits.transl + shift, fits.rest_joints[:, 0])
        matrix: Float64 = camera_from_world(camera.R, moved) @ world
        return matrix

    def answer(subject: Subject) -> Answer:
        return Answer(torch.from_numpy(folded(metres)).to(subject.like))

    def truth(subject: Subject) -> Answer:
        return Answer(torch.from_numpy(folded(0.0)).to(subject.like))

    # 53 bits of a number of that size, a few roundings deep, then the cast to float32.
    rounding = 16 * metres * 2.0**-53
    bounds = Bounds(rounding, rounding + 1e-6, rounding + 1e-6)
    name = f"world coordinates {metres:.0e} m away"
    measured = "camera_from_body, folded in float64, then cast (m)"
    return Case("input", name, measured, bounds, answer, truth)


def _refused(name: str, header: SequenceHeader, wanted: int) -> Case:
    def answer(subject: Subject) -> Answer:
        found = [*camera_findings(header), *fit_findings(header)]
        errors = [finding for finding in found if finding.severity == "error"]
        note = f"{errors[0].entry}: {errors[0].sentence}" if errors else ""
        return Answer(subject.like.new_tensor([float(bool(errors))]), note=note)

    def truth(subject: Subject) -> Answer:
        return Answer(subject.like.new_tensor([float(wanted)]))

    return Case("input", name, "refused by the check: 1, not: 0", REFUSED, answer, truth)


def centimetre_headers(header: SequenceHeader) -> dict[str, SequenceHeader]:
    """The sequence with one thing, or everything, in centimetres.

    Args:
        header: in metres.
    """
    fits, shape = header.fits, header.shape
    body = replace(
        fits,
        rest_joints=CENTIMETRES * fits.rest_joints,
        posed_joints=CENTIMETRES * fits.posed_joints,
        posed_vertices=(CENTIMETRES * fits.posed_vertices).astype(np.float32),
    )
    body = replace(body, world_from_body=_world(body))
    grown = replace(
        shape,
        rest_joints=CENTIMETRES * shape.rest_joints,
        rest_vertices=(CENTIMETRES * shape.rest_vertices).astype(np.float32),
    )
    cameras = tuple(replace(camera, T=CENTIMETRES * camera.T) for camera in header.cameras)
    walked = replace(fits, transl=CENTIMETRES * fits.transl)
    return {
        "cameras": replace(header, cameras=cameras),
        "translations": replace(header, fits=replace(walked, world_from_body=_world(walked))),
        "the body": replace(header, fits=body, shape=grown),
        "everything": replace(header, fits=body, shape=grown, cameras=cameras),
    }


def _world(fits: BodyFits) -> Float64:
    return world_from_body(fits.global_orient, fits.transl, fits.rest_joints[:, 0])


def invented_header() -> SequenceHeader:
    """A sound sequence of the invented actor: one camera, a few frames, no pictures."""
    actor = invented_actor()
    joints, vertices = actor.joints.numpy(), actor.vertices.numpy()
    poses = 0.3 * dance_poses(FRAMES, torch.Generator().manual_seed(2)).numpy()
    orient = np.stack([np.array([0.0, 0.4 * frame, 0.0]) for frame in range(FRAMES)])
    rest = np.repeat(joints[None], FRAMES, axis=0)
    transl = np.tile([0.5, 1.2, 2.0], (FRAMES, 1))
    posed = posed_joints(poses, rest)
    around = np.repeat(posed, 3, axis=1) + np.tile([[-0.05], [0.0], [0.05]], (24, 3))
    fits = BodyFits(
        global_orient=orient,
        transl=transl,
        body_pose=poses[:, 1:],
        betas=np.zeros((FRAMES, 10)),
        world_from_body=world_from_body(orient, transl, rest[:, 0]),
        rest_joints=rest,
        posed_joints=posed,
        posed_vertices=around.astype(np.float32),
    )
    return SequenceHeader(
        sequence="invented",
        actor="invented",
        world_up=np.array([0.0, 1.0, 0.0]),
        cameras=(_camera(transl[0]),),
        frames=np.arange(FRAMES, dtype=np.int64),
        fits=fits,
        shape=ActorShape(np.zeros(10), joints, vertices.astype(np.float32)),
        protocols=(),
        provenance=Provenance(
            dataset="synthetic",
            variant="invented",
            body_model="balls",
            scale=1.0,
            background="dropped",
            mask_source="drawn",
            source_terms="free",
            notes=(),
            source_digests=(),
        ),
    )


def _camera(target: Float64) -> Camera:
    matrix = camera_around(torch.from_numpy(target), 0.6, 3.0).numpy()
    K = np.array([[100.0, 0.0, 39.5], [0.0, 100.0, 49.5], [0.0, 0.0, 1.0]])
    return Camera(
        name="one",
        source_index=0,
        K=K,
        R=matrix[:3, :3],
        T=matrix[:3, 3],
        size=(80, 100),
        source_K=K,
        source_distortion=np.zeros(5),
        source_size=(80, 100),
    )


__all__ = ["centimetre_headers", "input_cases", "invented_header"]
