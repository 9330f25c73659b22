"""What the support views' feature maps hold where points project."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.interpolation import Layer, bilinear
from actorsnerf_model.projection import project

FAR_OUTSIDE = -1e4
"""A pixel coordinate outside every picture: reading there gives zeros."""


@dataclass(frozen=True)
class SupportCameras:
    """The K support views' pinhole cameras."""

    K: Float[Tensor, "views 3 3"]
    camera_from_body: Float[Tensor, "views 4 4"]
    """Each from its own frame's posed body frame."""
    edges: Float[Tensor, "views 2 2"]
    """Where the full picture begins and ends, x, y, in the crop's pixels: half a pixel beyond the
    centres of its outermost ones."""


def read_features(
    features: FeatureMap,
    cameras: SupportCameras,
    points: Float[Tensor, "views points 3"],
    layer: Layer | None = None,
) -> Float[Tensor, "views points read"]:
    """Each view's features where its copy of the points projects, bilinear.

    Zero outside the picture, as in the released code, also where the view's crop hangs over the
    picture's edge: the crop has background there, which nobody saw. (A view that is smaller than
    the largest goes on as plain background to the right and below, up to the picture's edge.) Zero
    behind the camera too, where the released code reads a mirrored place or infinity. Nothing tests
    whether a point is hidden.

    Args:
        features: of K views.
        cameras: of the same views.
        points: posed body frame of each view's frame, metres.
        layer: linear, without bias, that the features still go through.
    """
    seen = project(points, cameras.K, cameras.camera_from_body)
    low, high = cameras.edges[:, None].unbind(2)
    inside = ((seen.pixels >= low) & (seen.pixels <= high)).all(-1)
    pixels = torch.where((seen.in_front & inside)[..., None], seen.pixels, FAR_OUTSIDE)
    return bilinear(features.table, features.cells(pixels), layer)
