"""Synthetic data sets: dancing people that nobody has to be asked for, as raw trees of two formats.

The trees are read by the same preprocessors as the real data sets.
"""

from actorsnerf_preprocess.stage import PRESETS, SyntheticOptions
from actorsnerf_preprocess.synthetic_aist import write_aist_tree
from actorsnerf_preprocess.synthetic_zju import write_zju_tree

__all__ = ["PRESETS", "SyntheticOptions", "write_aist_tree", "write_zju_tree"]
