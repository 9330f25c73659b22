import pytest
import torch

from actorsnerf_model.constants import constant


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.int64])
def test_type_and_device_are_the_other_tensors(dtype: torch.dtype) -> None:
    like = torch.zeros(1, dtype=dtype)
    made = constant([1, 3], like)
    assert made.dtype == dtype and torch.equal(made, like.new_tensor([1, 3]))
    assert constant([1, 3], like.to("meta")).device.type == "meta"


@pytest.mark.gpu
def test_a_gpu_is_not_waited_for() -> None:
    like = torch.zeros(1, device="cuda")
    constant([1.0], like)  # starts the device
    torch.cuda.set_sync_debug_mode("error")
    try:
        made = constant([1.0, 2.0], like)
    finally:
        torch.cuda.set_sync_debug_mode("default")
    assert made.tolist() == [1.0, 2.0]
