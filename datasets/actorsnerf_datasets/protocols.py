"""Who does what in a study: the published ActorsNeRF protocols, and a generic one.

Published ranges are *positions* in the list of a sequence's frames; what is stored are *numbers*,
the frame's name in the source. The two differ for ZJU-MoCap 313 and 315 (numbers start at 1), 396
(starts at 810) and AIST++ (every fourth video frame from 200).
"""

import dataclasses
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actorsnerf_datasets.coverage import choose_frames, view_directions, visibility
from actorsnerf_datasets.published import (
    AIST_EVALUATION,
    AIST_EXTRA,
    AIST_FIRST,
    AIST_FIVE_SHOT,
    AIST_POOL,
    AIST_PRETRAINING,
    AIST_SEQUENCES,
    AIST_STEP,
    AIST_SUPPORT,
    FEWSHOT_SKIPS,
    ZJU_396_FIRST,
    ZJU_PRETRAINING,
    ZJU_SUPPORT,
)
from actorsnerf_datasets.types import (
    BodyFits,
    Camera,
    Float64,
    Int64,
    ListName,
    Protocol,
    Role,
    Shots,
)

SUPPORT_COUNT = 3
"""K, the support frames of a few-shot setting (paper, §4)."""
SHOT_COUNTS = (5, 10, 30, 100, 300)
"""M, the training frames of the few-shot settings (paper, table 1)."""
SHORT_VIDEO_COUNT = 10
SHORT_VIDEO_SPAN = 100
"""The short-video setting takes 10 of 100 consecutive frames (paper, §4.3)."""

GENERIC_POOL = 300
GENERIC_POOL_SHARE = 0.6
GENERIC_PRETRAINING = 550
GENERIC_EVALUATION_COUNT = 25


def zju_role(subject: str) -> Role | None:
    """What ActorsNeRF uses a ZJU-MoCap subject for, also where its protocol does not apply.

    None if the subject is in no published list.

    >>> zju_role("CoreView_387"), zju_role("377"), zju_role("395")
    ('held_out', 'pretraining', None)
    """
    number = _zju_number(subject)
    if number in ZJU_SUPPORT:
        return "held_out"
    return "pretraining" if number in ZJU_PRETRAINING else None


def aist_role(dancer: str) -> Role | None:
    """What ActorsNeRF uses an AIST++ dancer for, whichever of the dances it is.

    None if the dancer is in no published list.

    >>> aist_role("d16"), aist_role("d01"), aist_role("d31")
    ('held_out', 'pretraining', None)
    """
    if dancer in AIST_FIVE_SHOT:
        return "held_out"
    return "pretraining" if dancer in AIST_SEQUENCES else None


def zju_protocol(
    subject: str, camera_names: Sequence[str], frame_numbers: Int64
) -> Protocol | None:
    """ActorsNeRF's ZJU-MoCap protocol for a subject, or None if it does not apply.

    The training camera is the first. Held-out subjects (387, 393, 394) are evaluated on positions
    301, 311, …, 541 and the cameras at positions 1 to 22.

    * 313, 315: position 0 is frame 1.
    * 390: positions 600 to 1149, not the first 550.
    * 396: positions count from frame 810, because the fits of earlier frames do not belong to
      their pictures (the released script as committed pairs picture i with fit i + 810). Raw trees
      are read up to frame 1349, which gives 540; all 550 would be frames 810 to 1359.
    * Few-shot lists are the released ones, including that frame 0 is in the 5-shot list only.
    * Short video: frames 10, 20, …, 100, supports 10, 70, 100, for all three.
    * A short sequence gives a short pre-training list; a few-shot list that is not complete is
      left out; without any, or without evaluation frames, the protocol does not apply.

    Args:
        subject: `387`, `CoreView_387`, `my_387`.
        camera_names: in the order of the source.
        frame_numbers: of the whole sequence, ascending, also those that turn out unusable.

    Source: released code (dataset_args, finetune_300frame, eval).
    """
    number = _zju_number(subject)
    if number in ZJU_PRETRAINING:
        frames = frame_numbers[frame_numbers >= ZJU_396_FIRST] if number == "396" else frame_numbers
        used = frames[ZJU_PRETRAINING[number]]
        return _pretraining("actorsnerf-zju", camera_names, used) if len(used) else None
    if number not in ZJU_SUPPORT:
        return None
    lists = [(5, tuple(range(0, 301, 75)), ZJU_SUPPORT[number][5])]
    for count, skip in FEWSHOT_SKIPS.items():
        lists.append((count, tuple(range(skip, 301, skip)), ZJU_SUPPORT[number][count]))
    at = dict(enumerate(frame_numbers.tolist()))
    shots = [_official(_few(count), frames, support, at) for count, frames, support in lists]
    shots.append(_official("short-video", tuple(range(10, 101, 10)), (10, 70, 100), at))
    return _held_out(
        "actorsnerf-zju", camera_names, camera_names[1:23], frame_numbers[301:550:10], shots
    )


def aist_protocol(
    sequence: str, camera_names: Sequence[str], frame_numbers: Int64
) -> Protocol | None:
    """ActorsNeRF's AIST++ protocol for a sequence, or None if it is not one of the 30.

    Frames are video frames 200, 204, 208, …; other numbers are passed over. The training camera is
    c01; held-out dancers (d16 to d20) are evaluated on positions 300, 310, … without the last
    position, and on c02 to c08. c09 looks from the same side as c01 and is never used.

    * The 10-, 30-, 100- and 300-shot lists are three hand-picked frames and every 30th, 10th, 3rd
      or single position of the first 300 without its last three. Some hand-picked frames are in
      the regular part already: such a frame is stored once, so d18 has 9 frames at 10 shots, 29 at
      30 and 99 at 100, d19 99 at 100, and all have 297 at 300.
    * The support frames are the released ones, also where they are not among the training frames
      (d16: 840 is in neither the 10- nor the 100-shot list).
    * Short video: 200, 240, …, 560 with supports 200, 400, 560, which the released code sketches
      and the paper does not report.
    * A short sequence gives fewer frames; lists that are not complete are left out.

    Args:
        sequence: the sequence's name, with `cAll`.
        camera_names: c01 to c09, those there are.
        frame_numbers: video frames, ascending.

    Source: released code (prepare_AIST_zju_format, dataset_args, finetune_300frame).
    """
    dancer = next((key for key, name in AIST_SEQUENCES.items() if name == sequence), None)
    if dancer is None or "c01" not in camera_names:
        return None
    cameras = ["c01", *(name for name in camera_names if "c02" <= name <= "c08")]
    used = frame_numbers[(frame_numbers >= AIST_FIRST) & (frame_numbers % AIST_STEP == 0)]
    if dancer not in AIST_FIVE_SHOT:
        frames = used[AIST_PRETRAINING]
        return _pretraining("actorsnerf-aist", cameras, frames) if len(frames) else None
    support, there = AIST_SUPPORT[dancer], {frame: frame for frame in used.tolist()}
    shots = [_official(_few(5), AIST_FIVE_SHOT[dancer], support, there)]
    pool = AIST_FIRST + AIST_STEP * np.arange(AIST_POOL.stop)
    for count, skip in FEWSHOT_SKIPS.items():
        regular = pool[::skip][:-3].tolist()
        shots.append(_official(_few(count), (*regular, *AIST_EXTRA[dancer]), support, there))
    shots.append(_official("short-video", tuple(range(200, 561, 40)), (200, 400, 560), there))
    evaluation = used[AIST_EVALUATION]
    return _held_out("actorsnerf-aist", cameras, cameras[1:], evaluation, shots)


def generic_protocol(role: Role, camera_names: Sequence[str], frame_numbers: Int64) -> Protocol:
    """A protocol after the paper's rules for an actor outside the published lists.

    The training camera is the first. Pre-training takes the first 550 frames. A held-out actor's
    pool is the first 300 frames, or 60 % of a sequence of fewer than 500; the few-shot lists take
    M of them for each M that there is, the short video 10 of the pool's first third (100 frames of
    300). Evaluation takes up to 25 frames evenly from those after the pool, and all other cameras
    (the only camera, if there is no other).

    The lists called `official` are the paper's uniform rule ("sampled uniformly from 300
    consecutive frames"), nobody's publication: every (P/M)-th frame of a pool of P, ending with the
    last, and as supports every (M/3)-th of those.

    Args:
        role: what the actor is used for.
        camera_names: in the order of the source.
        frame_numbers: ascending.
    """
    if role == "pretraining":
        return _pretraining("generic", camera_names, frame_numbers[:GENERIC_PRETRAINING])
    numbers = frame_numbers.tolist()
    pool = numbers[: min(GENERIC_POOL, int(GENERIC_POOL_SHARE * len(numbers)))]
    shots = [_uniform(_few(count), pool, count) for count in SHOT_COUNTS if count <= len(pool)]
    clip = pool[: min(SHORT_VIDEO_SPAN, len(pool) // 3)]
    if len(clip) >= SHORT_VIDEO_COUNT:
        shots.append(_uniform("short-video", clip, SHORT_VIDEO_COUNT))
    after = numbers[len(pool) :]
    step = max(1, len(after) // GENERIC_EVALUATION_COUNT)
    return Protocol(
        name="generic",
        role="held_out",
        training_camera=camera_names[0],
        evaluation_cameras=tuple(camera_names[1:] or camera_names),
        pretraining_frames=(),
        evaluation_frames=tuple(after[::step][:GENERIC_EVALUATION_COUNT]),
        shots=tuple(shots),
    )


def with_automatic_lists(
    protocol: Protocol,
    frames: Int64,
    fits: BodyFits,
    camera: Camera,
    usable: NDArray[np.bool_] | None = None,
) -> Protocol:
    """The protocol with an `auto` list beside each `official` one, chosen to cover the body.

    Each automatic list has as many frames as the official one has, and chooses them by
    `coverage.choose_frames` from all frames between the first and the last that official few-shot
    lists use (for the short video: from the 100 frames that end with its last). Its first three
    choices are the support frames. Existing automatic lists are replaced; with fewer than three
    usable frames there is none.

    Args:
        protocol: with official lists; one without any (pre-training) comes back as it is.
        frames: (F,) the sequence's frame numbers, ascending.
        fits: of the same frames.
        camera: the protocol's training camera.
        usable: (F,) frames whose training picture has a usable mask; None means all.
    """
    official = tuple(shots for shots in protocol.shots if shots.list_name == "official")
    if not official:
        return protocol
    allowed = np.ones(len(frames), np.bool_) if usable is None else usable
    seen = visibility(view_directions(fits, camera))
    used = [frame for shots in official for frame in (*shots.frames, *shots.support)]
    pool = np.flatnonzero(allowed & (frames >= min(used)) & (frames <= max(used)))
    longest = max(len(shots.frames) for shots in official)
    order = _best(pool, seen, longest)
    auto: list[Shots] = []
    for shots in official:
        best = order
        if shots.name == "short-video":
            clip = pool[frames[pool] <= max(shots.frames)][-SHORT_VIDEO_SPAN:]
            best = _best(clip, seen, len(shots.frames))
        numbers = frames[best[: len(shots.frames)]].tolist()
        if len(numbers) >= SUPPORT_COUNT:
            auto.append(_shots(shots.name, "auto", numbers, numbers[:SUPPORT_COUNT]))
    return dataclasses.replace(protocol, shots=(*official, *auto))


def needed_pairs(protocol: Protocol) -> set[tuple[str, int]]:
    """The (camera name, frame number) pairs whose pictures the protocol uses."""
    training = set(protocol.pretraining_frames)
    for shots in protocol.shots:
        training |= {*shots.frames, *shots.support}
    pairs = {(protocol.training_camera, frame) for frame in training}
    for camera in protocol.evaluation_cameras:
        pairs |= {(camera, frame) for frame in protocol.evaluation_frames}
    return pairs


def _zju_number(subject: str) -> str:
    found = re.search(r"(?<!\d)\d{3}(?!\d)", subject)
    return found.group() if found else ""


def _best(pool: Int64, seen: Float64, count: int) -> Int64:
    return pool[np.array(choose_frames(seen[pool], count), np.int64)]


def _few(count: int) -> str:
    return f"fewshot-{count}"


def _shots(name: str, list_name: ListName, frames: Sequence[int], support: Sequence[int]) -> Shots:
    """Distinct frames, ascending."""
    return Shots(name, list_name, tuple(sorted(set(frames))), tuple(sorted(set(support))))


def _official(
    name: str, frames: Sequence[int], support: Sequence[int], numbers: dict[int, int]
) -> Shots | None:
    """The list with each key replaced by its frame number; None if one is not there."""
    if not {*frames, *support} <= numbers.keys():
        return None
    listed = [numbers[frame] for frame in frames]
    return _shots(name, "official", listed, [numbers[frame] for frame in support])


def _uniform(name: str, pool: Sequence[int], count: int) -> Shots:
    frames = _spread(pool, count)
    return _shots(name, "official", frames, _spread(frames, SUPPORT_COUNT))


def _spread(frames: Sequence[int], count: int) -> list[int]:
    return [frames[(index + 1) * len(frames) // count - 1] for index in range(count)]


def _pretraining(name: str, camera_names: Sequence[str], frames: Int64) -> Protocol:
    return Protocol(
        name=name,
        role="pretraining",
        training_camera=camera_names[0],
        evaluation_cameras=(),
        pretraining_frames=tuple(frames.tolist()),
        evaluation_frames=(),
        shots=(),
    )


def _held_out(
    name: str,
    camera_names: Sequence[str],
    evaluation_cameras: Sequence[str],
    evaluation_frames: Int64,
    shots: Sequence[Shots | None],
) -> Protocol | None:
    complete = tuple(one for one in shots if one is not None)
    if not complete or not len(evaluation_frames) or not evaluation_cameras:
        return None
    return Protocol(
        name=name,
        role="held_out",
        training_camera=camera_names[0],
        evaluation_cameras=tuple(evaluation_cameras),
        pretraining_frames=(),
        evaluation_frames=tuple(evaluation_frames.tolist()),
        shots=complete,
    )
