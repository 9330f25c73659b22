import pytest
import torch

from actorsnerf_model.kinematics import bone_motions
from actorsnerf_model.skinning import backward_warp, forward_warp
from actorsnerf_train.stability import round_trips as module
from actorsnerf_train.stability.bench import Bench
from actorsnerf_train.stability.hard_poses import dance_poses
from actorsnerf_train.stability.round_trips import ONE_BONE_BOUND, one_bone_volume, round_trips


def test_where_one_bone_acts_the_warps_are_inverses(bench: Bench) -> None:
    subject = bench.subjects[1]
    body, joints = subject.state.body, subject.supports[0].canonical_joints
    hard = one_bone_volume(body.skinning, joints)
    rows = round_trips(hard, joints, body.geometry.rest_vertices, 0.01, 30)
    everything = rows[-1]
    assert everything.region == "all"
    assert everything.one_bone_trips > 100
    assert 0 < everything.one_bone_largest <= ONE_BONE_BOUND
    assert everything.largest > 0.01
    assert sum(row.trips for row in rows[:-1]) == everything.trips


def test_errors_are_those_of_the_two_warps(bench: Bench) -> None:
    subject = bench.subjects[0]
    body, joints = subject.state.body, subject.supports[0].canonical_joints
    volume, vertices = body.skinning, body.geometry.rest_vertices
    rows = round_trips(volume, joints, vertices, 0.0, 3)
    errors = []
    for pose in dance_poses(3, torch.Generator().manual_seed(module.SEED)):
        there, back = bone_motions(pose, joints, joints)
        posed, _ = forward_warp(vertices, volume, back[None])
        home, _ = backward_warp(posed[0], volume, there)
        errors.append((home - vertices).norm(dim=-1))
    assert rows[-1].largest == pytest.approx(float(torch.stack(errors).max()), rel=1e-6)
    assert rows[-1].median == pytest.approx(float(torch.stack(errors).median()), rel=0.05)


def test_at_rest_nobody_travels(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = bench.subjects[0]
    body, joints = subject.state.body, subject.supports[0].canonical_joints
    monkeypatch.setattr(module, "dance_poses", lambda count, _: torch.zeros(count, 24, 3))
    rows = round_trips(body.skinning, joints, body.geometry.rest_vertices, 0.01, 2)
    assert {row.region for row in rows} == {*module.REGIONS, "all"}
    assert rows[-1].largest < 1e-14
    assert rows[-1].lost == 0


def test_what_is_not_finite_is_said(bench: Bench) -> None:
    subject = bench.subjects[0]
    body, joints = subject.state.body, subject.supports[0].canonical_joints
    broken = joints.clone()
    broken[20] = torch.nan
    rows = round_trips(body.skinning, broken, body.geometry.rest_vertices, 0.01, 2)
    assert not rows[-1].finite


def test_every_node_has_one_owner(bench: Bench) -> None:
    subject = bench.subjects[0]
    joints = subject.supports[0].canonical_joints
    volume = one_bone_volume(subject.state.body.skinning, joints)
    assert bool((volume.weights.sum(0) == 1).all())
    assert bool((volume.weights.amax(0) == 1).all())
    still = torch.eye(4).to(joints).expand(24, 4, 4)
    _, likelihood = backward_warp(joints, volume, still)
    torch.testing.assert_close(likelihood, torch.ones_like(likelihood))
