"""A prepared sequence on one screen."""

import numpy as np

from actorsnerf_datasets.cameras import camera_centre
from actorsnerf_datasets.protocols import needed_pairs
from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_datasets.types import Protocol, SequenceHeader


def describe(sequence: SequenceFile) -> str:
    """What is in the file: who, where from, cameras, frames, pictures, protocols, decisions.

    Raises:
        LayoutError: the file is no prepared sequence of this layout.
    """
    header = sequence.header
    lines = [
        f"{sequence.path} ({sequence.path.stat().st_size / 1e6:.1f} MB)",
        *_source_lines(header),
        *_body_lines(header),
        *_picture_lines(sequence),
        *_camera_lines(sequence),
        *(line for protocol in header.protocols for line in _protocol_lines(protocol)),
        *(f"note        {note}" for note in header.provenance.notes),
        f"digest      {sequence.digest}",
    ]
    return "\n".join(lines)


def _source_lines(header: SequenceHeader) -> list[str]:
    source = header.provenance
    return [
        f"actor       {header.actor}, sequence {header.sequence}",
        f"source      {source.dataset}: {source.variant}; terms: {source.source_terms}",
        f"masks       {source.mask_source}; background {source.background}",
    ]


def _body_lines(header: SequenceHeader) -> list[str]:
    height = float(np.ptp(header.shape.rest_vertices, axis=0)[1])
    count = len(header.shape.rest_vertices)
    numbers = header.frames
    steps = np.unique(np.diff(numbers)).tolist()
    every = f"every {steps[0]}" if len(steps) == 1 else "with gaps"
    return [
        f"body        {header.provenance.body_model}, {count} vertices, {height:.2f} m at rest",
        f"frames      {len(numbers)}: {numbers[0]} to {numbers[-1]}, {every}",
    ]


def _picture_lines(sequence: SequenceFile) -> list[str]:
    width, height = sequence.crop_size
    count, usable = len(sequence.offsets), int(sequence.valid.sum())
    scale = sequence.header.provenance.scale
    return [
        f"pictures    {count} crops of {width} x {height} at scale {scale:g}, {usable} usable, of "
        f"{sequence.row.size} camera-frame pairs"
    ]


def _camera_lines(sequence: SequenceFile) -> list[str]:
    header = sequence.header
    position = header.fits.world_from_body[:, :3, 3].mean(axis=0)
    lines: list[str] = []
    for index, camera in enumerate(header.cameras):
        width, height = camera.size
        away = float(np.linalg.norm(camera_centre(camera.R, camera.T) - position))
        label = "cameras     " if index == 0 else " " * 12
        lines.append(
            f"{label}{camera.name}: {width} x {height}, f {camera.K[0, 0]:.0f} px, {away:.1f} m "
            f"away, {int(sequence.valid[index].sum())} usable pictures"
        )
    return lines


def _protocol_lines(protocol: Protocol) -> list[str]:
    lines = [
        f"protocol    {protocol.name}: {protocol.role}, training camera "
        f"{protocol.training_camera}, uses {len(needed_pairs(protocol))} pictures"
    ]
    if protocol.pretraining_frames:
        lines.append(f"            pre-training on {_range(protocol.pretraining_frames)}")
    if protocol.evaluation_frames:
        cameras = len(protocol.evaluation_cameras)
        lines.append(
            f"            evaluation on {_range(protocol.evaluation_frames)}, {cameras} cameras"
        )
    for shots in protocol.shots:
        support = ", ".join(str(frame) for frame in shots.support)
        lines.append(
            f"            {shots.name} ({shots.list_name}): {_range(shots.frames)}, "
            f"support {support}"
        )
    return lines


def _range(frames: tuple[int, ...]) -> str:
    return f"{len(frames)} frames {min(frames)} to {max(frames)}"
