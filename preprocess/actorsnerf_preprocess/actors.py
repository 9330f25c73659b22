"""Synthetic actors: a body shape, an outfit, and the meshes of the dressed person in any pose."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from actorsnerf_datasets import body_model, conventions
from actorsnerf_datasets.skeleton import joint_transforms
from actorsnerf_datasets.types import Float32, Float64, Int64, Role, UInt8
from actorsnerf_preprocess.atlas import SeamedMesh, cut_seams, texel_values
from actorsnerf_preprocess.cloth_regions import (
    CIHP_HAIR,
    CIHP_SKIRT,
    CIHP_TOP,
    CIHP_TROUSERS,
    cihp_labels,
    cloth_depth,
    in_hair,
)
from actorsnerf_preprocess.free_body import (
    Atlas,
    Garment,
    free_body,
    free_body_atlas,
    free_wardrobe,
)
from actorsnerf_preprocess.motions import Motion
from actorsnerf_preprocess.outfits import Outfit, draw_outfit
from actorsnerf_preprocess.paint import paint_fabric, paint_hair, paint_person
from actorsnerf_preprocess.renderer import Mesh, MeshRenderer, Paint

TEXTURE_SIZE = 768
"""Texels per side on body and suit: about 3 mm on skin."""
SMALL_TEXTURE_SIZE = 256
BETA_LIMIT = 1.8
BETA_SPREAD = 0.8
HIDDEN = -0.03
"""Metres under the skin where cloth goes that is not worn."""
HEM = 0.012
"""Metres over which cloth dives under the skin at its edges."""
HAIR_EASE = {"cropped": 0.006, "full": 0.020, "bun": 0.010, "bob": 0.008, "long": 0.008}
HAIR_ENDS = {"bob": 0.24, "long": 0.02}
"""Height where long hair is cut."""
LAG_SECONDS = 0.16
"""How far back the hem of a skirt and the ends of long hair remember, seconds."""
LAG_SHARE = 0.6
SKIRT_END = -0.62


@dataclass(frozen=True)
class Actor:
    """Who: name, shape and clothes."""

    name: str
    role: Role
    betas: Float64
    """(10,)."""
    outfit: Outfit


@dataclass(frozen=True)
class Wear:
    """One textured layer of the person at rest, shared by all actors."""

    garment: Garment
    mesh: SeamedMesh
    vertices_from_faces: csr_matrix
    """(V, F) sums what the faces around a vertex say."""
    positions: Float32
    """(T, T, 3) rest position of each texel."""


@dataclass(frozen=True)
class Studio:
    """The free body and its wardrobe, prepared for drawing once per process."""

    body: body_model.BodyModel
    skin: Wear
    suit: Wear
    skirt: Wear
    hair: Wear


@dataclass(frozen=True)
class Part:
    """The faces of a layer that carry one label."""

    label: int
    rows: Int64
    """(P,) vertices of the seamed mesh that its faces use."""
    faces: Int64
    """(F, 3) into `rows`."""


@dataclass(frozen=True)
class Layer:
    """One layer of one actor."""

    wear: Wear
    ease: Float64
    """(V,) how far the layer stands off, along its normals, metres."""
    lag: Float64
    """(V,) share of the past in where the layer is."""
    parts: tuple[Part, ...]
    paint: Paint


@dataclass(frozen=True)
class DressedActor:
    """An actor ready to be drawn by one renderer."""

    actor: Actor
    body: body_model.BodyModel
    layers: tuple[Layer, ...]


@dataclass(frozen=True)
class FramePose:
    """Where a body is in one frame."""

    body: body_model.PosedBody
    world_from_body: Float64
    """(4, 4)."""
    transforms: tuple[Float64, ...]
    """(24, 4, 4) world from rest, now and at a few earlier times."""


def actor_name(index: int, role: Role) -> str:
    """What the `index`-th actor of a role is called.

    >>> actor_name(0, "pretraining"), actor_name(3, "held_out")
    ('actor00', 'heldout03')
    """
    return f"{'actor' if role == 'pretraining' else 'heldout'}{index:02d}"


def draw_actor(seed: int, index: int, role: Role, shaped: bool = True) -> Actor:
    """The `index`-th synthetic actor of a role; the same seed gives the same person.

    Unless `shaped`, all betas are zero.
    """
    rng = np.random.default_rng([seed, index, int(role == "held_out")])
    betas = np.clip(rng.normal(0.0, BETA_SPREAD, 10), -BETA_LIMIT, BETA_LIMIT) * float(shaped)
    return Actor(actor_name(index, role), role, betas, draw_outfit(rng, index, role))


def open_studio(texture_size: int = TEXTURE_SIZE) -> Studio:
    """The free body and its wardrobe with their texel maps; takes about two seconds."""
    body = free_body()
    skin = Garment(
        body.template, body.shape_directions, body.weights, body.faces, free_body_atlas()
    )
    wardrobe = free_wardrobe()
    return Studio(
        body,
        _wear(skin, texture_size),
        _wear(_subdivided(wardrobe["suit"]), texture_size),
        _wear(wardrobe["skirt"], SMALL_TEXTURE_SIZE),
        _wear(wardrobe["hair"], SMALL_TEXTURE_SIZE),
    )


def dress(studio: Studio, actor: Actor, renderer: MeshRenderer) -> DressedActor:
    """The actor with paints uploaded to `renderer`."""
    outfit = actor.outfit
    skin_paint = renderer.paint(paint_person(studio.skin.positions, outfit))
    suit_paint = renderer.paint(paint_person(studio.suit.positions, outfit), double_sided=True)
    layers = [_skin_layer(studio, outfit, skin_paint), _suit_layer(studio, outfit, suit_paint)]
    if outfit.bottom_cut == "skirt":
        texture = paint_fabric(studio.skirt.positions, outfit.bottom, outfit.noise_seed)
        layers.append(_skirt_layer(studio, renderer.paint(texture, double_sided=True)))
    if outfit.hair_style in HAIR_ENDS:
        texture = paint_hair(studio.hair.positions, outfit.hair)
        layers.append(_hair_layer(studio, outfit, renderer.paint(texture, double_sided=True)))
    return DressedActor(actor, studio.body, tuple(layers))


def frame_pose(dressed: DressedActor, motion: Motion, frame: int) -> FramePose:
    """The body in one frame, with what lagging layers need to know of the frames before."""
    steps = np.linspace(0.0, LAG_SECONDS * motion.frames_per_second, 4)
    frames = [max(frame - round(float(step)), 0) for step in steps]
    betas, body = dressed.actor.betas, dressed.body
    posed = body_model.pose(body, betas, motion.poses[frame])
    rest_joints = posed.rest_joints
    placed = [
        conventions.world_from_body(motion.global_orient[at], motion.transl[at], rest_joints[0])
        for at in frames
    ]
    transforms = [
        world @ joint_transforms(motion.poses[at], rest_joints)
        for at, world in zip(frames, placed, strict=True)
    ]
    return FramePose(posed, placed[0], tuple(transforms))


def skin_in_world(dressed: DressedActor, pose: FramePose) -> tuple[Float64, Float64]:
    """The undressed body's vertices (V, 3) and unit normals (V, 3) in the motion's world."""
    world = pose.world_from_body
    vertices = pose.body.vertices @ world[:3, :3].T + world[:3, 3]
    return vertices, _normals(vertices, dressed.layers[0].wear)


def draw_meshes(dressed: DressedActor, pose: FramePose) -> list[Mesh]:
    """The dressed actor's meshes in the motion's world."""
    meshes = []
    for number, layer in enumerate(dressed.layers):
        if number == 0:
            vertices, normals = skin_in_world(dressed, pose)
        else:
            vertices = _posed_layer(layer, dressed.actor.betas, pose)
            normals = _normals(vertices, layer.wear)
        standing = vertices + layer.ease[:, None] * normals
        source, uv = layer.wear.mesh.source, layer.wear.mesh.uv
        for part in layer.parts:
            rows = source[part.rows]
            drawn = standing[rows].astype(np.float32)
            drawn_normals = normals[rows].astype(np.float32)
            meshes.append(
                Mesh(drawn, drawn_normals, part.faces, uv[part.rows], layer.paint, part.label)
            )
    return meshes


def _posed_layer(layer: Layer, betas: Float64, pose: FramePose) -> Float64:
    garment = layer.wear.garment
    rest = garment.template + garment.shape_directions @ betas
    now = body_model.lbs(rest, garment.weights, pose.transforms[0])
    if not layer.lag.any():
        return now
    past = [body_model.lbs(rest, garment.weights, earlier) for earlier in pose.transforms[1:]]
    share = layer.lag[:, None]
    lagging: Float64 = (1 - share) * now + share * np.mean([now, *past], axis=0)
    return lagging


def _normals(vertices: Float64, wear: Wear) -> Float64:
    a, b, c = (vertices[wear.garment.faces[:, corner]] for corner in range(3))
    summed = wear.vertices_from_faces @ np.cross(b - a, c - a)
    normals: Float64 = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)
    return normals


def _wear(garment: Garment, texture_size: int) -> Wear:
    faces = garment.faces
    incidence = csr_matrix(
        (np.ones(faces.size), (faces.ravel(), np.repeat(np.arange(len(faces)), 3))),
        shape=(len(garment.template), len(faces)),
    )
    span = np.ptp(garment.atlas.uv, axis=0)
    uv = ((garment.atlas.uv - garment.atlas.uv.min(axis=0)) / span).astype(np.float32)
    atlas = Atlas(uv, garment.atlas.faces)
    positions = texel_values(garment.template, faces, atlas, texture_size)
    return Wear(garment, cut_seams(faces, atlas), incidence, positions)


def _subdivided(garment: Garment) -> Garment:
    """Every triangle split into four at the middles of its edges."""

    def split(faces: Int64) -> tuple[Int64, Int64]:
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = index.reshape(-1, 3) + faces.max() + 1
        a, b, c = faces.T
        ab, bc, ca = middle.T
        corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        return np.concatenate([np.stack(corner, axis=1) for corner in corners]), unique

    faces, edges = split(garment.faces)
    uv_faces, uv_edges = split(garment.atlas.faces)

    def refined(values: Float64, pairs: Int64) -> Float64:
        return np.concatenate([values, 0.5 * (values[pairs[:, 0]] + values[pairs[:, 1]])])

    return Garment(
        refined(garment.template, edges),
        refined(garment.shape_directions, edges),
        refined(garment.weights, edges),
        faces,
        Atlas(refined(garment.atlas.uv.astype(np.float64), uv_edges).astype(np.float32), uv_faces),
    )


def _parts(wear: Wear, labels: UInt8, kept: NDArray[np.bool_] | None = None) -> tuple[Part, ...]:
    """The seamed faces by label; `kept` (F,) drops faces where it is false."""
    chosen = np.ones(len(labels), dtype=bool) if kept is None else kept
    parts = []
    for label in np.unique(labels[chosen]):
        corners = wear.mesh.faces[chosen & (labels == label)]
        rows, faces = np.unique(corners, return_inverse=True)
        parts.append(Part(int(label), rows, faces.reshape(-1, 3)))
    return tuple(parts)


def _middles(garment: Garment) -> Float64:
    middles: Float64 = garment.template[garment.faces].mean(axis=1)
    return middles


def _quad_middles(garment: Garment) -> Float64:
    """(F, 3) the middle of the quad that each face is half of; faces come in such pairs."""
    middles = _middles(garment).reshape(-1, 2, 3).mean(axis=1)
    return np.repeat(middles, 2, axis=0)


def _skin_layer(studio: Studio, outfit: Outfit, paint: Paint) -> Layer:
    points = studio.skin.garment.template
    ease = HAIR_EASE[outfit.hair_style] * in_hair(points)
    if outfit.hair_style == "bun":
        ease = ease + 0.05 * np.exp(-np.sum((points - [0.0, 0.47, -0.075]) ** 2, axis=1) / 0.0011)
    shoe = np.clip((-1.06 - points[:, 1]) / 0.03, 0.0, 1.0)
    labels = cihp_labels(_middles(studio.skin.garment), outfit)
    none = np.zeros(len(points))
    return Layer(studio.skin, ease + 0.008 * shoe, none, _parts(studio.skin, labels), paint)


def _suit_layer(studio: Studio, outfit: Outfit, paint: Paint) -> Layer:
    garment = studio.suit.garment
    depth = cloth_depth(garment.template, outfit)
    over_hem = np.clip((garment.template[:, 1] - outfit.top_hem) / 0.01, 0.0, 1.0)
    worn = outfit.bottom_ease + (outfit.top_ease - outfit.bottom_ease) * over_hem
    ease = np.where(depth > HEM, worn, HIDDEN + (worn - HIDDEN) * np.clip(depth / HEM + 0.9, 0, 1))
    visible: NDArray[np.bool_] = np.any((depth > -HEM)[garment.faces], axis=1)
    top = _middles(garment)[:, 1] > outfit.top_hem
    labels = np.where(top, CIHP_TOP, CIHP_TROUSERS).astype(np.uint8)
    return Layer(
        studio.suit, ease, np.zeros(len(ease)), _parts(studio.suit, labels, visible), paint
    )


def _skirt_layer(studio: Studio, paint: Paint) -> Layer:
    """The skirt, its lowest rows pulled up to a level hem."""
    garment = studio.skirt.garment
    shortened = garment.template.copy()
    shortened[:, 1] = np.maximum(shortened[:, 1], SKIRT_END)
    wear = replace(studio.skirt, garment=replace(garment, template=shortened))
    hanging = np.clip((-0.25 - shortened[:, 1]) / 0.3, 0.0, 1.0)
    kept: NDArray[np.bool_] = shortened[garment.faces, 1].max(axis=1) > SKIRT_END
    labels = np.full(len(garment.faces), CIHP_SKIRT, dtype=np.uint8)
    ease = 0.004 + 0.05 * hanging
    return Layer(wear, ease, LAG_SHARE * hanging, _parts(wear, labels, kept), paint)


def _hair_layer(studio: Studio, outfit: Outfit, paint: Paint) -> Layer:
    garment = studio.hair.garment
    middles = _quad_middles(garment)
    in_face = (middles[:, 2] > 0.075) & (middles[:, 1] < 0.5)
    kept = (middles[:, 1] > HAIR_ENDS[outfit.hair_style]) & ~in_face
    loose = np.clip((0.3 - garment.template[:, 1]) / 0.25, 0.0, 1.0)
    labels = np.full(len(garment.faces), CIHP_HAIR, dtype=np.uint8)
    ease = np.zeros(len(loose))
    return Layer(studio.hair, ease, LAG_SHARE * loose, _parts(studio.hair, labels, kept), paint)
