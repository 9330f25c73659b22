"""The one common loader: prepared files in, `Sample`s of torch tensors out.

The only module of this package that imports torch. A sample is a function of (seed, index) alone,
so any number of workers, a resumed run and a distributed run see the same samples.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional
from torch.utils.data import Dataset

from actorsnerf_datasets.body_box import body_box
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.patches import PatchScene, draw_patches
from actorsnerf_datasets.picture_cache import PictureCache
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.selection import (
    FewshotChoice,
    camera_index,
    find_protocol,
    find_shots,
    pretraining_protocol,
    usable,
)
from actorsnerf_datasets.types import Float32, Picture

_PRETRAINING, _FEWSHOT = 1, 2
"""Keep the random numbers of the two datasets apart."""


@dataclass(frozen=True)
class View:
    """One picture of an actor with its camera and pose; body frame, metres, crop pixels."""

    image: Float[Tensor, "height width 3"]
    """Straight RGB in [0, 1]."""
    alpha: Float[Tensor, "height width"]
    """The person's share of the pixel, in [0, 1]."""
    K: Float[Tensor, "3 3"]
    """Intrinsics of the crop; the centre of its top-left pixel is (0, 0)."""
    camera_from_body: Float[Tensor, "4 4"]
    """Rigid, OpenCV camera from body frame; folded in float64, then cast."""
    pose: Float[Tensor, "24 3"]
    """Axis-angle of each joint; the root is zero (it is folded into the camera)."""
    rest_joints: Float[Tensor, "24 3"]
    """Of this frame's betas, body frame."""
    rest_vertices: Float[Tensor, "vertices 3"]
    """Of the actor, body frame."""
    posed_vertices: Float[Tensor, "vertices 3"]
    """Of this frame, body frame."""
    canonical_joints: Float[Tensor, "24 3"]
    """The actor's rest joints (mean betas), body frame."""
    actor: str
    camera: str
    frame: int
    offset: tuple[int, int]
    """x, y of the crop in the full picture."""
    full_size: tuple[int, int]
    """Width, height of the full picture."""


@dataclass(frozen=True)
class Sample:
    """A target view, K support views of the same actor, and the target's pixels to render."""

    target: View
    supports: tuple[View, ...]
    patches: Int[Tensor, "patches side side 2"]
    """x, y pixel coordinates inside the target's crop."""


def view_at(sequence: SequenceFile, camera: str | int, frame_number: int) -> View:
    """The stored picture of a camera and frame as a view.

    Args:
        sequence: prepared file.
        camera: its name, or its position in the file.
        frame_number: of the source, not a position.

    Raises:
        UserError: no such camera or frame, or no valid picture of the two.
    """
    c, f = camera_index(sequence, camera), sequence.frame_index(frame_number)
    usable(sequence, c, (frame_number,), "asked for")
    return _view(sequence, (c, f), sequence.picture(c, f), sequence.posed_vertices(f))


def pad_views(views: Sequence[View]) -> tuple[View, ...]:
    """The views with their crops grown to one size: zeros to the right and below, alpha 0."""
    height = max(view.alpha.shape[0] for view in views)
    width = max(view.alpha.shape[1] for view in views)
    return tuple(_padded(view, height, width) for view in views)


class PretrainingDataset(Dataset[Sample]):
    """Samples of many actors, for the category-level training.

    The target of an item is uniform over all (actor, frame) pairs of the files' pre-training
    frames at their training cameras; its supports are K distinct other frames of the same
    sequence. Items exist for every index >= 0; `steps` is only what `len` says.
    """

    def __init__(
        self,
        files: Sequence[Path],
        seed: int,
        k: int,
        patches: int,
        patch_size: int,
        steps: int,
    ) -> None:
        """Open the files and list their frames.

        Args:
            files: prepared files whose actors have the role `pretraining`.
            seed: of all draws.
            k: support views.
            patches: how many a sample has.
            patch_size: pixels a side.
            steps: length of the data set.

        Raises:
            UserError: no files, one of a held-out actor, or too few usable frames.
        """
        if not files:
            raise UserError("pre-training needs at least one prepared file, none was given")
        self.files = tuple(SequenceFile(path) for path in files)
        self._drawing = _Drawing(seed, patches, patch_size, steps)
        self._k = k
        self._cameras: list[int] = []
        self._frames: list[tuple[int, ...]] = []
        for file in self.files:
            protocol = pretraining_protocol(file)
            camera = camera_index(file, protocol.training_camera)
            frames = [file.frame_index(n) for n in protocol.pretraining_frames]
            self._cameras.append(camera)
            self._frames.append(tuple(f for f in frames if file.valid[camera, f]))
            if len(self._frames[-1]) <= k:
                raise UserError(
                    f"{file.path}: has {len(self._frames[-1])} usable pre-training frames at "
                    f"camera {protocol.training_camera}, but a target and {k} supports need "
                    f"{k + 1}: leave the file out, or prepare more frames"
                )
        self._ends = np.cumsum([len(frames) for frames in self._frames])
        self._cache = PictureCache()

    def __len__(self) -> int:
        return self._drawing.steps

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Sample:
        """The sample of an index; a function of it and the seed alone."""
        rng = np.random.default_rng([self._drawing.seed, _PRETRAINING, index])
        pair = int(rng.integers(self._ends[-1]))
        i = int(np.searchsorted(self._ends, pair, side="right"))
        frames = self._frames[i]
        chosen = pair - int(self._ends[i]) + len(frames)
        others = rng.choice(len(frames) - 1, size=self._k, replace=False)
        others = others + (others >= chosen)  # steps over the target
        source = _Source(self.files[i], self._cameras[i], self._cache, i)
        supports = tuple(source.view(frames[int(n)]) for n in others)
        target = frames[chosen]
        return Sample(source.view(target), supports, source.patches(target, rng, self._drawing))


class FewshotDataset(Dataset[Sample]):
    """Samples of one held-out actor, for fitting to its M frames.

    Items carry no supports: these are the same for all, see `supports`. The target of an item is
    uniform over the M frames. Items exist for every index >= 0; `steps` is only what `len` says.
    """

    def __init__(
        self,
        file: Path,
        choice: FewshotChoice,
        seed: int,
        patches: int,
        patch_size: int,
        steps: int,
    ) -> None:
        """Open the file and read its lists.

        Args:
            file: prepared file of an actor with the role `held_out`.
            choice: which protocol, setting and list; how many supports.
            seed: of all draws.
            patches: how many a sample has.
            patch_size: pixels a side.
            steps: length of the data set.

        Raises:
            UserError: the file lacks the setting or valid pictures for it, its actor was for
                pre-training, or there are fewer frames or supports than asked for.
        """
        self.file = SequenceFile(file)
        self._drawing = _Drawing(seed, patches, patch_size, steps)
        self.protocol = find_protocol(self.file, choice.protocol)
        self.shots = find_shots(self.file, self.protocol, choice)
        self._camera = camera_index(self.file, self.protocol.training_camera)
        usable(self.file, self._camera, self.shots.frames, f"frames of {self.shots.name}")
        usable(self.file, self._camera, self.shots.support, f"supports of {self.shots.name}")
        self._frames = tuple(self.file.frame_index(n) for n in self.shots.frames)
        self._cache = PictureCache()
        source = _Source(self.file, self._camera, self._cache, 0)
        self.supports = pad_views(
            [source.view(self.file.frame_index(n)) for n in self.shots.support]
        )
        """The K support views, in the order of the list."""

    def __len__(self) -> int:
        return self._drawing.steps

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> Sample:
        """The sample of an index; a function of it and the seed alone."""
        rng = np.random.default_rng([self._drawing.seed, _FEWSHOT, index])
        frame = self._frames[int(rng.integers(len(self._frames)))]
        source = _Source(self.file, self._camera, self._cache, 0)
        return Sample(source.view(frame), (), source.patches(frame, rng, self._drawing))


@dataclass(frozen=True)
class _Drawing:
    seed: int
    patches: int
    patch_size: int
    steps: int


@dataclass(frozen=True)
class _Source:
    """One camera of one file, its pictures through the cache."""

    file: SequenceFile
    camera: int
    cache: PictureCache
    key: int

    def picture(self, frame: int) -> Picture:
        return self.cache.get(
            (self.key, self.camera, frame), lambda: self.file.picture(self.camera, frame)
        )

    def view(self, frame: int) -> View:
        key = (self.key, "vertices", frame)
        vertices = self.cache.get(key, lambda: self.file.posed_vertices(frame))
        return _view(self.file, (self.camera, frame), self.picture(frame), vertices)

    def patches(
        self, frame: int, rng: np.random.Generator, drawing: _Drawing
    ) -> Int[Tensor, "patches side side 2"]:
        picture = self.picture(frame)
        scene = PatchScene(
            alpha=picture.alpha,
            K=self.file.crop_K(self.camera, frame),
            camera_from_body=self.file.camera_from_body(self.camera, frame),
            box=body_box(self.file.header.fits.posed_joints[frame]),
            offset=picture.offset,
            full_size=self.file.header.cameras[self.camera].size,
        )
        try:
            return torch.from_numpy(draw_patches(rng, scene, drawing.patches, drawing.patch_size))
        except UserError as error:
            header = self.file.header
            place = f"camera {header.cameras[self.camera].name}, frame {header.frames[frame]}"
            raise UserError(f"{self.file.path}: {place}: {error}") from None


def _view(
    sequence: SequenceFile, place: tuple[int, int], picture: Picture, vertices: Float32
) -> View:
    header, (camera, frame) = sequence.header, place
    pose = np.concatenate([np.zeros((1, 3)), header.fits.body_pose[frame]])
    return View(
        image=torch.from_numpy(picture.rgb).float().div_(255.0),
        alpha=torch.from_numpy(picture.alpha).float().div_(255.0),
        K=torch.from_numpy(sequence.crop_K(camera, frame)).float(),
        camera_from_body=torch.from_numpy(sequence.camera_from_body(camera, frame)).float(),
        pose=torch.from_numpy(pose).float(),
        rest_joints=torch.from_numpy(header.fits.rest_joints[frame]).float(),
        # Copied: the header and the cache keep these two, and a sample is its reader's own.
        rest_vertices=torch.tensor(header.shape.rest_vertices, dtype=torch.float32),
        posed_vertices=torch.tensor(vertices, dtype=torch.float32),
        canonical_joints=torch.from_numpy(header.shape.rest_joints).float(),
        actor=header.actor,
        camera=header.cameras[camera].name,
        frame=int(header.frames[frame]),
        offset=picture.offset,
        full_size=header.cameras[camera].size,
    )


def _padded(view: View, height: int, width: int) -> View:
    right, below = width - view.alpha.shape[1], height - view.alpha.shape[0]
    return replace(
        view,
        image=functional.pad(view.image, (0, 0, 0, right, 0, below)),
        alpha=functional.pad(view.alpha, (0, right, 0, below)),
    )
