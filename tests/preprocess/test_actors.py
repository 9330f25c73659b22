from collections.abc import Iterator

import numpy as np
import pytest

from actorsnerf_datasets.body_model import rest
from actorsnerf_datasets.conventions import world_from_body
from actorsnerf_datasets.skeleton import posed_joints
from actorsnerf_preprocess.actors import (
    BETA_LIMIT,
    LAG_SECONDS,
    DressedActor,
    Studio,
    draw_actor,
    draw_meshes,
    dress,
    frame_pose,
    open_studio,
    skin_in_world,
)
from actorsnerf_preprocess.motions import Motion, draw_motion
from actorsnerf_preprocess.renderer import MeshRenderer

FPS = 15.0


@pytest.fixture(scope="module")
def studio() -> Studio:
    return open_studio(64)


@pytest.fixture(scope="module")
def renderer() -> Iterator[MeshRenderer]:
    with MeshRenderer() as made:
        yield made


@pytest.fixture(scope="module")
def skirted(studio: Studio, renderer: MeshRenderer) -> DressedActor:
    actors = (draw_actor(0, index, "pretraining") for index in range(20))
    return dress(studio, next(a for a in actors if a.outfit.bottom_cut == "skirt"), renderer)


@pytest.fixture(scope="module")
def motion(studio: Studio, skirted: DressedActor) -> Motion:
    joints, _ = rest(studio.body, skirted.actor.betas)
    yaw = np.linspace(0, 1, 20)
    return draw_motion(np.random.default_rng(2), "step", yaw, joints, FPS)


def test_the_seed_decides_the_actor() -> None:
    first, again = draw_actor(3, 1, "held_out"), draw_actor(3, 1, "held_out")
    assert first.name == "heldout01"
    np.testing.assert_array_equal(first.betas, again.betas)
    assert first.outfit == again.outfit
    for other in (draw_actor(4, 1, "held_out"), draw_actor(3, 2, "held_out")):
        assert not np.array_equal(first.betas, other.betas)
    assert np.abs(first.betas).max() <= BETA_LIMIT
    assert draw_actor(3, 1, "pretraining").name == "actor01"


def test_a_frame_is_placed_by_the_standard_convention(
    skirted: DressedActor, motion: Motion
) -> None:
    pose = frame_pose(skirted, motion, 7)
    joints, _ = rest(skirted.body, skirted.actor.betas)
    expected = world_from_body(motion.global_orient[7], motion.transl[7], joints[0])
    np.testing.assert_allclose(pose.world_from_body, expected)
    np.testing.assert_allclose(pose.body.joints, posed_joints(motion.poses[7], joints), atol=1e-9)


def test_the_past_reaches_back_as_far_as_the_lag(skirted: DressedActor, motion: Motion) -> None:
    pose = frame_pose(skirted, motion, 10)
    np.testing.assert_array_equal(
        pose.transforms[-1],
        frame_pose(skirted, motion, 10 - round(LAG_SECONDS * FPS)).transforms[0],
    )
    for transform in frame_pose(skirted, motion, 0).transforms[1:]:
        np.testing.assert_array_equal(transform, frame_pose(skirted, motion, 0).transforms[0])


def test_the_skin_is_the_posed_body_where_nothing_stands_off(
    skirted: DressedActor, motion: Motion
) -> None:
    pose = frame_pose(skirted, motion, 5)
    meshes = draw_meshes(skirted, pose)
    layer = skirted.layers[0]
    world, _ = skin_in_world(skirted, pose)
    shares = []
    for mesh, part in zip(meshes, layer.parts, strict=False):
        rows = layer.wear.mesh.source[part.rows]
        bare = layer.ease[rows] == 0
        shares.append(bare.mean())
        np.testing.assert_allclose(mesh.vertices[bare], world[rows][bare], atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    assert max(shares) == 1


def test_clothes_stand_off_the_skin(skirted: DressedActor, motion: Motion) -> None:
    """The suit has a shape of its own, a centimetre or two outside."""
    worn = skirted.layers[1].ease
    assert 0.005 < np.median(worn[worn > 0]) < 0.03
    meshes = draw_meshes(skirted, frame_pose(skirted, motion, 5))
    assert len(meshes) == sum(len(layer.parts) for layer in skirted.layers)
    assert len({mesh.label for mesh in meshes}) >= 5


def test_a_skirt_lags_the_motion_and_skin_does_not(skirted: DressedActor, motion: Motion) -> None:
    lags = [layer.lag.max() for layer in skirted.layers]
    assert lags[:2] == [0, 0]
    assert max(lags) > 0.3
    # The same pose after another past: the skirt's hem differs, the skin does not.
    held = Motion(
        np.repeat(motion.poses[[9]], 20, axis=0),
        np.repeat(motion.global_orient[[9]], 20, axis=0),
        np.repeat(motion.transl[[9]], 20, axis=0),
        FPS,
    )
    moving = draw_meshes(skirted, frame_pose(skirted, motion, 9))
    still = draw_meshes(skirted, frame_pose(skirted, held, 9))
    distance = [
        np.linalg.norm(one.vertices - other.vertices, axis=1).max()
        for one, other in zip(moving, still, strict=True)
    ]
    assert distance[0] == 0
    assert 0.002 < max(distance) < 0.3


def test_layers_draw_only_faces_that_are_worn(skirted: DressedActor) -> None:
    for number, layer in enumerate(skirted.layers):
        corners = [
            layer.wear.mesh.source[part.rows][part.faces].reshape(-1, 3) for part in layer.parts
        ]
        drawn, known = np.concatenate(corners), layer.wear.garment.faces
        every = {tuple(face) for face in known.tolist()}
        assert {tuple(face) for face in drawn.tolist()} <= every
        assert len(drawn) == len(known) if number == 0 else 0 < len(drawn) < len(known)
