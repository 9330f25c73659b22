"""A published test actor whose published protocol does not apply: held out all the same."""

from actorsnerf_datasets.types import Protocol
from actorsnerf_preprocess.source import Finding


def held_out_warning(actor: str, protocol: Protocol, reason: str, frames: int) -> Finding:
    """What a user reads about a published test actor with a generic protocol.

    Args:
        actor: its name.
        protocol: the generic one.
        reason: why the published one does not apply, a clause.
        frames: how many the sequence has.
    """
    lists = "with generic lists" if protocol.shots else f"its {frames} frames give no few-shot list"
    sentence = (
        f"{actor} is a test actor of the published experiments and is held out, {lists}: {reason}."
    )
    return Finding("warning", "protocol", sentence)
