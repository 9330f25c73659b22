"""How each known ZJU-MoCap tree calls its folders and files, as data for the writers of trees."""

from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

from actorsnerf_preprocess.zju_tree import Variant

TreeVariant = Literal[Variant, "converted-humannerf", "converted-actorsnerf"]
"""The trees with an `annots.npy`, as the reader calls them, and those of released preparations."""
STAMPED_FRAMES_PER_SECOND = 30.0


@dataclass(frozen=True)
class MaskFolder:
    """One set of masks."""

    path: str
    """Without suffix; fields as in `Layout.listed`, and `{picture}`, the picture's own path."""
    labels: bool
    """Part labels, else 0 and 1."""


@dataclass(frozen=True)
class FitFolder:
    """One set of fits with their vertices."""

    parameters: str
    vertices: str
    pose_blend: bool
    """Whether the vertices have SMPL's pose blend shapes."""


@dataclass(frozen=True)
class Layout:
    """One kind of tree with an `annots.npy`; paths are below the actor's folder."""

    folder: str
    """Of an actor; field `{actor}`."""
    cameras: tuple[str, ...]
    """The names of all cameras that this kind of tree has, in the order of `annots.npy`."""
    first: int
    """Number of the first frame."""
    listed: str
    """A picture's path in `annots.npy`, without suffix; fields `{camera}`, `{number}` (the
    frame's), `{long}` (the recorder's long file name)."""
    masks: tuple[MaskFolder, ...]
    fits: tuple[FitFolder, ...]
    stored: str | None = None
    """A picture's path on disk, if it is not the one in `annots.npy`."""
    plain_lists: bool = False
    """Cameras are lists of lists in place of arrays."""
    rootless: bool = False
    """Poses have 69 numbers, without the root."""

    def listed_name(self, folder: str, camera: int, number: int) -> str:
        """What `annots.npy` calls a picture; `folder` is the name of the actor's folder.

        >>> LAYOUTS["classic-21"].listed_name("CoreView_313", 1, 1)
        'Camera (2)/CoreView_313_Camera_(2)_0001_2019-08-23_16-08-00.001.jpg'
        """
        return self._filled(self.listed, folder, camera, number) + ".jpg"

    def stored_name(self, folder: str, camera: int, number: int) -> str:
        """Where a picture lies.

        >>> LAYOUTS["renamed-21"].stored_name("CoreView_313", 1, 1)
        'Camera (2)/0001.jpg'
        """
        return self._filled(self.stored or self.listed, folder, camera, number) + ".jpg"

    def mask_name(self, masks: MaskFolder, folder: str, camera: int, number: int) -> str:
        """Where a picture's mask lies.

        >>> refined = LAYOUTS["refined"]
        >>> refined.mask_name(refined.masks[0], "my_377", 3, 7)
        'mask/03/000007.png'
        """
        picture = PurePosixPath(self.stored_name(folder, camera, number)).with_suffix("")
        path = masks.path.replace("{picture}", str(picture))
        return self._filled(path, folder, camera, number) + ".png"

    def _filled(self, path: str, folder: str, camera: int, number: int) -> str:
        name = self.cameras[camera]
        long = f"{folder}_{name.replace(' ', '_')}_{number:04d}_{_stamp(camera, number)}"
        return path.format(camera=name, number=number, long=long)


def _stamp(camera: int, number: int) -> str:
    """When a camera took its picture; cameras are a millisecond apart, as real ones are."""
    seconds = (number - 1) / STAMPED_FRAMES_PER_SECOND + 0.001 * camera
    return f"2019-08-23_16-{8 + int(seconds) // 60:02d}-{seconds % 60:06.3f}"


_IN_BRACKETS = tuple(f"Camera ({number})" for number in (*range(1, 20), 22, 23))
_NUMBERED = tuple(f"{index:02d}" for index in range(23))
_BOTH_MASKS = (MaskFolder("mask_cihp/{picture}", True), MaskFolder("mask/{picture}", False))
_BOTH_FITS = (
    FitFolder("params", "vertices", False),
    FitFolder("new_params", "new_vertices", True),
)

LAYOUTS: dict[TreeVariant, Layout] = {
    "classic-23": Layout(
        folder="CoreView_{actor}",
        cameras=tuple(f"Camera_B{number}" for number in range(1, 24)),
        first=0,
        listed="{camera}/{number:06d}",
        masks=_BOTH_MASKS,
        fits=_BOTH_FITS,
    ),
    "classic-21": Layout(
        folder="CoreView_{actor}",
        cameras=_IN_BRACKETS,
        first=1,
        listed="{camera}/{long}",
        masks=_BOTH_MASKS,
        fits=_BOTH_FITS,
        plain_lists=True,
    ),
    # Neural Human Performer's scripts: files renamed, `mask/` lost, new_params called params.
    "renamed-21": Layout(
        folder="CoreView_{actor}",
        cameras=_IN_BRACKETS,
        first=1,
        listed="{camera}/{long}",
        stored="{camera}/{number:04d}",
        masks=_BOTH_MASKS[:1],
        fits=(FitFolder("params", "vertices", True),),
        plain_lists=True,
    ),
    "refined": Layout(
        folder="my_{actor}",
        cameras=_NUMBERED,
        first=0,
        listed="images/{camera}/{number:06d}",
        masks=(MaskFolder("mask/{camera}/{number:06d}", False),),
        fits=(FitFolder("smpl_params", "smpl_vertices", True),),
    ),
    "easymocap": Layout(
        folder="{actor}",
        cameras=_NUMBERED,
        first=0,
        listed="images/{camera}/{number:05d}",
        masks=_BOTH_MASKS[:1],
        fits=(FitFolder("params", "vertices", True),),
        rootless=True,
    ),
}
