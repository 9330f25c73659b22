"""A picture of how far a training is: truth, prediction and error of one fixed sample."""

import torch

from actorsnerf_datasets.torch_dataset import Sample
from actorsnerf_datasets.types import UInt8
from actorsnerf_model.render import render
from actorsnerf_model.states import RenderOptions
from actorsnerf_train.batches import camera_of, on_background
from actorsnerf_train.methods import AnyMethod, KnownActor, step_state
from actorsnerf_train.pictures import error_picture, strip, to_bytes


def snapshot(
    method: AnyMethod, sample: Sample, known: KnownActor, window: float, options: RenderOptions
) -> UInt8:
    """The strip (H, W, 3): the sample's whole target, what the method makes of it, the error.

    The method is left in the mode it was in.
    """
    training = method.training
    method.eval()
    target = sample.target
    with torch.no_grad():
        actor, _ = step_state(method, sample.supports, known, window)
        pose = method.pose_state(actor, target.pose, target.rest_joints, target.frame)
        picture = render(method, actor, pose, camera_of(target), options).rgb
    method.train(training)
    truth = on_background(target, options.background)
    return strip([[to_bytes(truth), to_bytes(picture), error_picture(truth, picture)]])
