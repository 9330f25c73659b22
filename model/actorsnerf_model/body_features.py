"""SMPL features: what the support views show at the body's vertices, for the sparse network."""

import torch
from jaxtyping import Float
from torch import Tensor

from actorsnerf_model.encoder import FeatureMap
from actorsnerf_model.fourier import fourier_features
from actorsnerf_model.pixel_features import SupportCameras, read_features

VERTEX_OCTAVES = 10
"""Of the rest vertices' encoding, which has the identity too: 63 numbers."""


def vertex_channels(body_channels: int, views: int) -> int:
    """How many numbers each vertex carries into the sparse network.

    >>> vertex_channels(64, 3)
    255
    """
    return body_channels * views + 3 * (2 * VERTEX_OCTAVES + 1)


def vertex_features(
    reduced: FeatureMap,
    cameras: SupportCameras,
    posed_vertices: Float[Tensor, "views vertices 3"],
    rest_vertices: Float[Tensor, "vertices 3"],
) -> Float[Tensor, "vertices channels"]:
    """K views' features at each vertex, joined, then the encoding of the vertex at rest.

    Args:
        reduced: the encoder's reduced map.
        cameras: of the K views.
        posed_vertices: body frame of each view's frame, metres.
        rest_vertices: canonical frame, metres; encoded in metres, as released.
    """
    seen = read_features(reduced, cameras, posed_vertices).transpose(0, 1).flatten(1)
    place = fourier_features(rest_vertices, VERTEX_OCTAVES, identity=True)
    return torch.cat([seen, place.to(seen.dtype)], dim=1)
