"""What both passes over the pictures decide: the protocols' lists, and notes on what they lost."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.protocols import needed_pairs, with_automatic_lists
from actorsnerf_datasets.types import Int64, Protocol
from actorsnerf_datasets.writer import Conclusion
from actorsnerf_preprocess.picture_tasks import Outcome
from actorsnerf_preprocess.pictures import stored_camera
from actorsnerf_preprocess.probes import Probe
from actorsnerf_preprocess.run_report import picture_notes
from actorsnerf_preprocess.source import SourceSequence
from actorsnerf_preprocess.usable_lists import usable_pairs, usable_protocol


def concluded(
    source: SourceSequence, probes: Sequence[Probe], outcomes: Sequence[Outcome], scale: float
) -> Conclusion:
    """The protocols that the stored pictures can serve, and all that a prepared file notes.

    Args:
        source: what was prepared.
        probes: of the first pass.
        outcomes: of the second; pictures without one are not stored.
        scale: stored size / source size.
    """
    usable = np.zeros(source.wanted.shape, np.bool_)
    for outcome in outcomes:
        usable[outcome.camera, outcome.frame] = outcome.stored is not None
    notes = [*source.notes, *picture_notes(probes, outcomes)]
    listed: list[Protocol] = []
    names = [camera.name for camera in source.cameras]
    pairs = usable_pairs(names, source.frames, usable)
    for protocol in source.protocols:
        camera = names.index(protocol.training_camera)
        complete = with_automatic_lists(
            protocol,
            source.frames,
            source.fits,
            stored_camera(source.cameras[camera], scale),
            usable[camera] & _used(protocol, source.frames),
        )
        changed, changes = usable_protocol(complete, pairs)
        listed.append(changed)
        notes.extend(changes)
    return Conclusion(tuple(listed), tuple(notes))


def _used(protocol: Protocol, frames: Int64) -> NDArray[np.bool_]:
    """(F,) whether the protocol uses the training camera's picture of a frame.

    Pictures that are prepared beyond the protocol's do not change its lists.
    """
    used = [frame for camera, frame in needed_pairs(protocol) if camera == protocol.training_camera]
    return np.isin(frames, used)
