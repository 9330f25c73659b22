"""Who a ZJU-MoCap subject is in a study, and which of its pictures that study needs."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets import protocols
from actorsnerf_datasets.types import Protocol, Role
from actorsnerf_preprocess.aist_names import dancer_of
from actorsnerf_preprocess.held_out import held_out_warning
from actorsnerf_preprocess.source import Finding, Found, OpenOptions
from actorsnerf_preprocess.zju_tree import subject_of


def actor_of(found: Found) -> str:
    """The actor's name: the data set's number, or the folder's name without its prefix."""
    subject = subject_of(found.path.name)
    return f"zju-{subject}" if subject.isdigit() and found.dataset != "synthetic" else subject


def protocol_of(
    found: Found, options: OpenOptions, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> Protocol:
    """The published protocol of a subject, or the generic one with the role the user gave.

    A published test actor is held out in either, and so is a published pre-training actor whom the
    user names as held out.
    """
    numbers = np.array(frames, np.int64)
    subject = subject_of(found.path.name)
    named = {found.name, found.path.name, actor_of(found), subject} & set(options.held_out)
    role: Role = "held_out" if named or published_role(found) == "held_out" else "pretraining"
    official = protocols.zju_protocol(subject, list(cameras), numbers)
    if official is not None and official.role == role and found.dataset != "synthetic":
        return official
    return protocols.generic_protocol(role, list(cameras), numbers)


def published_role(found: Found) -> Role | None:
    """What the published experiments use an actor for; None for an actor outside their lists.

    A tree of ZJU-MoCap's form may be of an AIST++ dancer, whom the released scripts convert.
    """
    if found.dataset == "synthetic":
        return None
    name = found.path.name
    return protocols.zju_role(subject_of(name)) or protocols.aist_role(dancer_of(name))


def protocol_findings(
    found: Found, protocol: Protocol, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> tuple[Finding, ...]:
    """A warning, if a published test actor's published protocol does not apply."""
    if protocol.name != "generic" or published_role(found) != "held_out":
        return ()
    reason = "the published lists are for the videos of AIST++"
    if protocols.zju_role(subject_of(found.path.name)):
        reason = (
            "the published lists need more than 301 frames and more than one camera, and there "
            f"are {len(frames)} and {len(cameras)}"
        )
    return (held_out_warning(actor_of(found), protocol, reason, len(frames)),)


def protocol_notes(
    found: Found, protocol: Protocol, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> tuple[str, ...]:
    """What a file says about a generic protocol."""
    if protocol.name != "generic":
        return ()
    warnings = protocol_findings(found, protocol, cameras, frames)
    if warnings:
        return tuple(finding.sentence for finding in warnings)
    if published_role(found) is None:
        return (f"The actor is in no published list and counts as {protocol.role}.",)
    if protocol.role != published_role(found):
        return ("A published pre-training actor, held out because the user named it.",)
    return (
        f"The published protocol does not apply to these {len(frames)} frames; the actor counts as "
        f"{protocol.role}.",
    )


def wanted_pairs(
    protocol: Protocol, options: OpenOptions, cameras: tuple[str, ...], frames: tuple[int, ...]
) -> NDArray[np.bool_]:
    """(C, F): the pairs to prepare."""
    if options.pairs == "all":
        return np.ones((len(cameras), len(frames)), np.bool_)
    pairs = protocols.needed_pairs(protocol)
    return np.array([[(name, frame) in pairs for frame in frames] for name in cameras])


def weighed_findings(
    findings: tuple[Finding, ...],
    wanted: NDArray[np.bool_],
    existing: frozenset[tuple[int, int]],
    absent: set[str],
) -> tuple[Finding, ...]:
    """The findings; those about pictures that no wanted pair needs are only notes.

    Args:
        findings: of a tree.
        wanted: (C, F) pairs to prepare.
        existing: (camera index, frame position) of the pictures that are there.
        absent: entries of the findings that say that pictures are not there.
    """
    needed = {(int(camera), int(position)) for camera, position in np.argwhere(wanted)}
    if needed - existing:
        return findings
    return tuple(
        replace(finding, severity="note") if finding.entry in absent else finding
        for finding in findings
    )
