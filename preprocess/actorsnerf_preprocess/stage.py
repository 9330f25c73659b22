"""The invented stage: how large a synthetic data set is, who dances, where the cameras stand.

Shared by the writers of synthetic raw trees. World: y up, floor at y = 0, metres.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from actorsnerf_datasets.body_model import rest
from actorsnerf_datasets.types import Float64, Role
from actorsnerf_preprocess.actors import (
    TEXTURE_SIZE,
    DressedActor,
    FramePose,
    draw_actor,
    dress,
    frame_pose,
    open_studio,
)
from actorsnerf_preprocess.motions import DANCES, Dance, Motion, draw_motion, turning_yaw
from actorsnerf_preprocess.renderer import Light, Lighting, MeshRenderer, Pinhole
from actorsnerf_preprocess.source import SourceError
from actorsnerf_preprocess.zju_layouts import TreeVariant

LIGHTING = Lighting(
    (
        Light(np.array([-0.4, -1.0, -0.6]), 2.0),
        Light(np.array([0.7, -0.5, 0.8]), 1.2),
    ),
    0.35,
)
"""A key light, a fill light from behind, and what the room gives back."""
SIGN = "synthetic.json"
"""A file of this name at the root marks a tree written here; it comes last."""
UNFINISHED = "synthetic.json.part"
"""The sign's name while the tree is being written."""
HELD_OUT = "held_out.txt"
"""Names of the held-out actors, one per line."""
TRUTH = "truth"
"""Folder beside the data for what a real data set could not know."""
WAIST = 0.9
"""Height that all cameras look at, metres."""


@dataclass(frozen=True)
class SyntheticOptions:
    """How large and how imperfect a synthetic data set is."""

    actors: int = 8
    """Pre-training actors."""
    held_out: int = 2
    """Actors that pre-training must not see."""
    frames: int = 100
    """Per actor."""
    cameras: int = 6
    """At most 23 for ZJU-MoCap, 9 for AIST++."""
    size: int = 512
    """Height of the raw pictures, pixels; ZJU-MoCap's are square, AIST++'s 16:9."""
    zoom: float = 1.0
    """Focal length, times that of the data set's cameras."""
    seed: int = 0
    full: bool = False
    """Draw every camera of every frame, not only what the generic protocol uses."""
    variant: TreeVariant = "classic-23"
    """Which of ZJU-MoCap's trees."""
    fit_noise: bool = False
    """Fits are off by about 2 degrees per joint and 1 cm; the true ones are kept under truth/."""
    ragged_masks: bool = False
    """Masks have bites and bumps of a few pixels; the true ones are kept under truth/."""
    texture: int = TEXTURE_SIZE
    """Texels per side of skin and clothes."""


PRESETS: dict[str, SyntheticOptions] = {
    "tiny": SyntheticOptions(actors=4, held_out=1, frames=24, cameras=3, size=256, texture=512),
    "study": SyntheticOptions(actors=8, held_out=2, frames=80, cameras=4, size=384),
    "evaluation": SyntheticOptions(actors=8, held_out=2, frames=560, cameras=8, size=512),
}
"""`tiny` for a demonstration, `study` to see learning, `evaluation` with the paper's 300 + 250."""


@dataclass(frozen=True)
class Performance:
    """One actor dancing."""

    position: int
    """Place in the cast."""
    dressed: DressedActor
    motion: Motion
    dance: Dance

    @property
    def name(self) -> str:
        """The actor's name."""
        return self.dressed.actor.name

    @property
    def role(self) -> Role:
        """Pre-training or held out."""
        return self.dressed.actor.role

    def pose(self, frame: int) -> FramePose:
        """Where the body is in one frame."""
        return frame_pose(self.dressed, self.motion, frame)


def pool_size(frames: int) -> int:
    """How many frames the generic protocol gives to training.

    >>> pool_size(560), pool_size(100)
    (300, 60)
    """
    return min(300, int(0.6 * frames))


@dataclass(frozen=True)
class Recording:
    """How a data set records a dance."""

    frames_per_second: float
    stride: int = 1
    """Every so many frames are used by studies; dancers turn that much more slowly."""
    shaped: bool = True
    """Whether bodies differ by betas; AIST++ knows only one shape."""


def cast(options: SyntheticOptions) -> tuple[tuple[int, Role], ...]:
    """(index, role) of all actors, pre-training first.

    >>> cast(SyntheticOptions(actors=2, held_out=1))
    ((0, 'pretraining'), (1, 'pretraining'), (0, 'held_out'))
    """
    training: list[tuple[int, Role]] = [(index, "pretraining") for index in range(options.actors)]
    return (*training, *((index, "held_out") for index in range(options.held_out)))


def performances(
    options: SyntheticOptions,
    renderer: MeshRenderer,
    recording: Recording,
    finished: Callable[[int], bool] = lambda position: False,
) -> Iterator[Performance]:
    """The actors one after the other, pre-training first; the seed decides all of them.

    Args:
        options: how many, and how long.
        renderer: gets their paints.
        recording: tempo of the dances and variety of the bodies.
        finished: places in the cast that are passed over.
    """
    studio = open_studio(options.texture)
    for position, (index, role) in enumerate(cast(options)):
        if finished(position):
            continue
        actor = draw_actor(options.seed, index, role, recording.shaped)
        rng = np.random.default_rng([options.seed, index, int(role == "held_out"), 1])
        used = -(-options.frames // recording.stride)
        turns = turning_yaw(rng, role, used, pool_size(used))
        yaw = np.interp(np.arange(options.frames) / recording.stride, np.arange(used), turns)
        joints, _ = rest(studio.body, actor.betas)
        dance = DANCES[role][index % len(DANCES[role])]
        motion = draw_motion(rng, dance, yaw, joints, recording.frames_per_second)
        yield Performance(position, dress(studio, actor, renderer), motion, dance)


def ring(
    count: int, radius: float, height: float, focal: float, size: tuple[int, int]
) -> tuple[Pinhole, ...]:
    """Cameras on a circle round the dancer, the first in front, all looking at the waist.

    Args:
        count: cameras.
        radius: metres from the axis.
        height: metres above the floor; every second camera stands 0.25 m higher.
        focal: pixels; each camera's differs by up to one percent, like real lenses.
        size: width, height.
    """
    angles = 2 * np.pi * np.arange(count) / max(count, 1)
    heights = height + 0.25 * (np.arange(count) % 2)
    return tuple(
        _camera(index, _around(float(angle), radius, float(tall)), focal, size)
        for index, (angle, tall) in enumerate(zip(angles, heights, strict=True))
    )


def require_sensible(options: SyntheticOptions, most_cameras: int, tree: str) -> None:
    """Nothing, if such a data set can be drawn.

    Args:
        options: its size.
        most_cameras: how many the tree can have; of a single one, more are ignored.
        tree: what it is called, with its article.

    Raises:
        SourceError: a number is too small or too large.
    """
    least = {"actors": 0, "held_out": 0, "frames": 2, "cameras": 1, "size": 32, "texture": 16}
    given = asdict(options)
    for name, smallest in least.items():
        if given[name] < smallest:
            flag = name.replace("_", "-")
            raise SourceError(f"--{flag} {given[name]}: expected {smallest} or more.")
    if not 0.1 <= options.zoom <= 10:
        raise SourceError(f"--zoom {options.zoom}: expected a factor from 0.1 to 10.")
    if not options.actors + options.held_out:
        raise SourceError("--actors 0 and --held-out 0: nobody is left to draw.")
    if options.cameras > most_cameras > 1:
        raise SourceError(
            f"--cameras {options.cameras}: {tree} tree has {most_cameras} cameras at most."
        )


def claim(root: Path, form: str, options: SyntheticOptions) -> bool:
    """Whether there is something left to write; makes the folder and signs it as unfinished.

    What another program or other options wrote is never mixed with; a tree of the same options
    that was left unfinished is gone on with.

    Raises:
        SourceError: there is something else in it.
    """
    sign = {"generator": "actorsnerf synthetic", "format": form, **asdict(options)}
    for name in (SIGN, UNFINISHED):
        if (root / name).is_file():
            if json.loads((root / name).read_text()) != sign:
                raise SourceError(
                    f"{root / name}: the folder holds a synthetic data set of other options; name "
                    "another folder, or delete this one."
                )
            return name == UNFINISHED
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise SourceError(
            f"{root}: is not empty and no synthetic data set (it has no {SIGN}); synthetic actors "
            "are written into a new or empty folder: name another."
        )
    root.mkdir(parents=True, exist_ok=True)
    (root / UNFINISHED).write_text(json.dumps(sign, indent=2) + "\n")
    return True


def keep_facts(root: Path, name: str, facts: dict[str, object]) -> None:
    """Writes what truth/ says of an actor; from then on it counts as finished."""
    part = root / TRUTH / f"{name}.json.part"
    part.parent.mkdir(parents=True, exist_ok=True)
    part.write_text(json.dumps(facts, indent=2) + "\n")
    part.replace(part.with_suffix(""))


def is_finished(root: Path, name: str) -> bool:
    """Whether all of an actor is written."""
    return (root / TRUTH / f"{name}.json").is_file()


def sign_finished(root: Path, held_out: list[str]) -> None:
    """Writes who is held out, and signs the tree."""
    (root / HELD_OUT).write_text("".join(f"{name}\n" for name in held_out))
    (root / UNFINISHED).replace(root / SIGN)


def _around(angle: float, radius: float, height: float) -> Float64:
    return np.array([radius * np.sin(angle), height, radius * np.cos(angle)])


def _camera(index: int, centre: Float64, focal: float, size: tuple[int, int]) -> Pinhole:
    forward = np.array([0.0, WAIST, 0.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    scale = 1 + 0.01 * np.sin(3.0 * index)
    middle = np.array(size) * (0.5 + 0.01 * np.array([np.sin(index), -np.cos(index)]))
    K = np.array(
        [
            [focal * scale, 0.0, middle[0]],
            [0.0, focal * (2 - scale), middle[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    return Pinhole(K, R, -R @ centre, size)
