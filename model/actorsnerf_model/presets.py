"""Named configurations: the released sizes, one for two CPU cores, and one for tests."""

from dataclasses import replace

from actorsnerf_model.actorsnerf import ActorsNeRFConfig
from actorsnerf_model.canonical_networks import CanonicalConfig, MotionConfig, RefinerConfig
from actorsnerf_model.deformation import DeformationConfig
from actorsnerf_model.encoder import EncoderConfig
from actorsnerf_model.humannerf import HumanNeRFConfig
from actorsnerf_model.neuralbody import NeuralBodyConfig
from actorsnerf_model.radiance import RadianceConfig
from actorsnerf_model.skinning_decoder import SkinningDecoderConfig
from actorsnerf_model.sparse_conv import SparseConfig
from actorsnerf_model.view_field import ViewFieldConfig

OFFICIAL = ActorsNeRFConfig()
"""The released code's sizes and constants."""

_SOFT = RadianceConfig(
    width=64, code=32, octaves=8, density="softplus", density_scale=100.0, density_shift=-2.0
)

OFFICIAL_SHORT = replace(
    OFFICIAL,
    encoder=EncoderConfig(weights="random"),
    radiance=RadianceConfig(density="softplus", density_scale=100.0, density_shift=-2.0),
)
"""The released sizes, so the released cost, but a density that some hundred steps can fill."""

SMALL = ActorsNeRFConfig(
    encoder=EncoderConfig(weights="random", body_channels=16),
    skinning=SkinningDecoderConfig(kind="direct"),
    deformation_net=DeformationConfig(width=64, depth=4, skip=2, code=16),
    sparse=SparseConfig(voxel=0.02, channels=(16, 24, 32), convolutions=(2, 2, 2), taps=(0, 1, 2)),
    radiance=_SOFT,
)
"""Learns on two CPU cores; ResNet-18 from scratch."""

SMALL_VGG = replace(
    SMALL,
    encoder=EncoderConfig(trunk="vgg16", weights="imagenet", train_trunk=False, body_channels=16),
)
"""The same with VGG-16's ImageNet trunk, which does not learn."""

TINY = ActorsNeRFConfig(
    encoder=EncoderConfig(weights="random", body_channels=4),
    skinning=SkinningDecoderConfig(kind="direct", resolution=16),
    deformation_net=DeformationConfig(width=16, depth=3, skip=2, octaves=3, code=4),
    sparse=SparseConfig(voxel=0.06, channels=(8, 8), convolutions=(1, 1), taps=(0, 1)),
    radiance=replace(_SOFT, width=64, code=16, octaves=4, density_shift=-5.0),
)
"""For tests and the demo: seconds."""

HUMANNERF_OFFICIAL = HumanNeRFConfig()
"""HumanNeRF's released sizes."""

HUMANNERF_OFFICIAL_SHORT = replace(
    HUMANNERF_OFFICIAL,
    canonical=CanonicalConfig(density="softplus", density_scale=100.0, density_shift=-2.0),
)
"""As `OFFICIAL_SHORT`."""

HUMANNERF_SMALL = HumanNeRFConfig(
    refiner=RefinerConfig(width=128),
    motion=MotionConfig(width=64, depth=4, skip=2),
    canonical=CanonicalConfig(
        width=128, octaves=8, density="softplus", density_scale=100.0, density_shift=-2.0
    ),
    skinning=SkinningDecoderConfig(kind="direct"),
)
"""As many products a point as `SMALL`'s deformation and rendering networks."""

HUMANNERF_TINY = HumanNeRFConfig(
    refiner=RefinerConfig(width=32, depth=2),
    motion=MotionConfig(width=16, depth=3, skip=2, octaves=3),
    canonical=CanonicalConfig(
        width=64,
        depth=4,
        skip=2,
        octaves=4,
        density="softplus",
        density_scale=100.0,
        density_shift=-5.0,
    ),
    skinning=SkinningDecoderConfig(kind="direct", resolution=16),
)
"""For tests."""

NEURALBODY_OFFICIAL = NeuralBodyConfig()
"""Neural Body's released sizes."""

NEURALBODY_OFFICIAL_SHORT = replace(
    NEURALBODY_OFFICIAL,
    field=ViewFieldConfig(density="softplus", density_scale=100.0, density_shift=-2.0),
)
"""As `OFFICIAL_SHORT`."""

NEURALBODY_SMALL = NeuralBodyConfig(
    sparse=SMALL.sparse,
    field=ViewFieldConfig(
        width=160,
        colour_width=80,
        latent=32,
        octaves=8,
        density="softplus",
        density_scale=100.0,
        density_shift=-2.0,
    ),
)
"""As many products a point as `SMALL`'s deformation and rendering networks."""

NEURALBODY_TINY = NeuralBodyConfig(
    code=8,
    sparse=TINY.sparse,
    field=ViewFieldConfig(
        width=64,
        colour_width=32,
        latent=8,
        octaves=4,
        direction_octaves=2,
        density="softplus",
        density_scale=100.0,
        density_shift=-5.0,
    ),
)
"""For tests."""
