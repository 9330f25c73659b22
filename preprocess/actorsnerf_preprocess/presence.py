"""Whether a picture shows somebody where the fitted body projects."""

import numpy as np

from actorsnerf_datasets.types import UInt8
from actorsnerf_preprocess.backgrounds import Background

DIFFERENT = 3.0
"""Units of the stage's noise: what differs by more is not the stage."""
SEEN_SHARE = 0.25
"""If fewer of the body's pixels than this share differ from the stage, nobody is there."""
KNOWN_SHARE = 0.3
"""If the stage is known behind fewer of the body's pixels than this, it cannot be told."""


def shows_somebody(picture: UInt8, stage: Background, body: UInt8) -> bool:
    """False if the picture shows the empty stage where the body should be.

    So it is with a black or frozen video, one of another take, or a calibration that is not the
    video's: a mask made there would be the body's own shape.

    Args:
        picture: (H, W, 3) RGB.
        stage: of the same camera.
        body: (H, W) silhouette of the fitted body in this picture.

    Returns:
        True also where it cannot be told.
    """
    judged = (body > 0) & stage.known
    if not judged.any() or judged.sum() < KNOWN_SHARE * (body > 0).sum():
        return True
    shown = picture[judged].astype(np.float32)
    change = np.abs(shown - stage.picture[judged]).mean(axis=1) / stage.noise[judged]
    return float((change > DIFFERENT).mean()) >= SEEN_SHARE
