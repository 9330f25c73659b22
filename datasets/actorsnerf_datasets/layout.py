"""The HDF5 layout, version 1: the name, axes, dtype and unit of every entry.

`datasets/README.md` explains the layout in prose; this module is what the writer, the reader and
the check share. Axes: C cameras, F frames, N stored pictures, V vertices, J = 24 joints,
B shape coefficients, H and W the height and width of the stored crops.
"""

from dataclasses import dataclass

FORMAT = "actorsnerf-sequence"
LAYOUT_MAJOR = 1
LAYOUT_MINOR = 0
LAYOUT_VERSION = f"{LAYOUT_MAJOR}.{LAYOUT_MINOR}"
JOINT_COUNT = 24


@dataclass(frozen=True)
class Entry:
    """One dataset of the file."""

    path: str
    axes: tuple[str, ...]
    dtype: str
    meaning: str


ENTRIES: tuple[Entry, ...] = (
    Entry("cameras/name", ("C",), "str", "name as in the source"),
    Entry("cameras/source_index", ("C",), "int32", "position in the source's camera list"),
    Entry("cameras/K", ("C", "3", "3"), "float64", "intrinsics of the full stored picture, pixels"),
    Entry("cameras/R", ("C", "3", "3"), "float64", "rotation, camera from world"),
    Entry("cameras/T", ("C", "3"), "float64", "translation, camera from world, metres"),
    Entry("cameras/size", ("C", "2"), "int32", "width, height of the full stored picture, pixels"),
    Entry("cameras/source_K", ("C", "3", "3"), "float64", "intrinsics as found, source pixels"),
    Entry("cameras/source_distortion", ("C", "5"), "float64", "k1 k2 p1 p2 k3 as found (OpenCV)"),
    Entry("cameras/source_size", ("C", "2"), "int32", "width, height of the source picture"),
    Entry("frames/number", ("F",), "int64", "frame number as in the source, ascending"),
    Entry("fits/global_orient", ("F", "3"), "float64", "rotation about the pelvis, axis-angle"),
    Entry("fits/transl", ("F", "3"), "float64", "SMPL translation, metres"),
    Entry("fits/body_pose", ("F", "23", "3"), "float64", "joints 1 to 23, axis-angle, radians"),
    Entry("fits/betas", ("F", "B"), "float64", "shape coefficients"),
    Entry("fits/world_from_body", ("F", "4", "4"), "float64", "rigid; folds orient and transl"),
    Entry("fits/rest_joints", ("F", "J", "3"), "float64", "body frame, metres, zero pose"),
    Entry("fits/posed_joints", ("F", "J", "3"), "float64", "body frame, metres"),
    Entry("fits/posed_vertices", ("F", "V", "3"), "float32", "body frame, metres"),
    Entry("actor/betas", ("B",), "float64", "mean over the prepared frames"),
    Entry("actor/rest_joints", ("J", "3"), "float64", "of the mean betas, body frame, metres"),
    Entry("actor/rest_vertices", ("V", "3"), "float32", "of the mean betas, body frame, metres"),
    Entry("pictures/rgb", ("N", "H", "W", "3"), "uint8", "straight (not premultiplied) sRGB crop"),
    Entry("pictures/alpha", ("N", "H", "W"), "uint8", "person's share of the pixel, 255 = all"),
    Entry("pictures/offset", ("N", "2"), "int32", "x, y of the crop's top-left pixel in the full"),
    Entry("pictures/row", ("C", "F"), "int32", "which picture; -1 = not stored"),
    Entry("pictures/valid", ("C", "F"), "bool", "stored, with a usable fit and mask"),
    Entry("provenance/source_path", ("S",), "str", "path inside the source folder"),
    Entry("provenance/source_sha256", ("S",), "str", "hex digest of that file"),
)
"""Every required dataset. `protocols/<protocol>/…` comes on top (see PROTOCOL_*)."""

ROOT_ATTRIBUTES: tuple[str, ...] = (
    "format",  # FORMAT
    "layout_version",  # LAYOUT_VERSION
    "dataset",  # zju-mocap | aist++ | synthetic | converted
    "variant",  # which of the data set's trees, one line
    "sequence",  # name in the source
    "actor",  # who; two sequences of one person share it
    "units",  # "metre"
    "angle_unit",  # "radian"
    "camera_convention",  # "opencv camera_from_world"
    "pixel_convention",  # "centre of the top-left pixel is (0, 0)"
    "smpl_convention",  # "v = R (x - j0) + j0 + transl"
    "world_up",  # 3 floats, unit vector
    "body_model",  # e.g. "smpl neutral", "cc0 body"
    "scale",  # stored picture size / source picture size
    "background",  # "dropped" | "kept"
    "mask_source",  # how the masks were made
    "tool_version",  # "actorsnerf 0.1.0"
    "source_terms",  # e.g. "redistribution = not allowed"
    "notes",  # JSON list of strings: every decision taken while preparing
)

PROTOCOL_ATTRIBUTES: tuple[str, ...] = ("role", "training_camera")
"""`role` is `pretraining` or `held_out`; cameras are named."""

PROTOCOL_DATASETS: tuple[str, ...] = (
    "evaluation_cameras",  # str
    "pretraining_frames",  # int64 frame numbers, not positions
    "evaluation_frames",  # int64 frame numbers
)
"""Few-shot lists: `protocols/<protocol>/shots/<name>/<official|auto>/{frames,support}`, int64."""

DIGEST_ATTRIBUTE = "sha256"
"""On every dataset: hex SHA-256 of its bytes (C order, little endian; strings as UTF-8 lines)."""
