"""Parts on cores of their own: the same results, and nothing left changed behind."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import pytest
import torch

from actorsnerf_model.cores import MOST, on_all_cores, side_by_side
from actorsnerf_model.render import RAYS_A_CORE, render
from actorsnerf_model.states import Camera, RenderOptions

if TYPE_CHECKING:
    from tests.model.conftest import ToyScene

CPU = torch.device("cpu")


@pytest.fixture
def two_threads() -> Iterator[None]:
    """torch's operations on two."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
@torch.no_grad()
def test_parts_have_a_core_each_and_keep_their_order() -> None:
    together = threading.Barrier(2, timeout=300)  # passes only while both are worked on
    seen = []

    def work(part: int) -> int:
        together.wait()
        seen.append((threading.get_ident(), torch.get_num_threads(), torch.is_grad_enabled()))
        return 10 * part

    assert on_all_cores(work, [3, 1, 2, 5], CPU) == [30, 10, 20, 50]
    assert {threads for _, threads, _ in seen} == {1}
    assert not any(grad for _, _, grad in seen)
    assert len({thread for thread, _, _ in seen} - {threading.get_ident()}) == 2


@pytest.mark.usefixtures("two_threads")
@torch.no_grad()
@pytest.mark.parametrize("fails", [False, True])
def test_threads_are_as_before_afterwards(fails: bool) -> None:
    def work(part: int) -> int:
        if fails:
            raise ArithmeticError(part)
        return part

    if fails:
        with pytest.raises(ArithmeticError):
            on_all_cores(work, [1, 2], CPU)
    else:
        assert on_all_cores(work, [1, 2], CPU) == [1, 2]
    assert torch.get_num_threads() == 2
    with ThreadPoolExecutor(1) as fresh:
        assert fresh.submit(torch.get_num_threads).result() == 2


@pytest.mark.usefixtures("two_threads")
def test_who_wants_gradients_works_alone() -> None:
    threads = on_all_cores(lambda part: threading.get_ident(), [0, 1], CPU)
    assert threads == [threading.get_ident()] * 2
    weight = torch.ones(2, requires_grad=True)
    sum(on_all_cores(lambda part: weight[part], [0, 1], CPU)).backward()  # type: ignore[union-attr]
    assert weight.grad is not None and weight.grad.tolist() == [1, 1]


@torch.no_grad()
def test_a_gpu_and_many_cores_have_their_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "get_num_threads", lambda: 64)
    assert side_by_side(torch.device("cuda")) == 1
    assert side_by_side(CPU) == MOST
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)
    assert side_by_side(CPU) == 1


@pytest.mark.usefixtures("two_threads")
@torch.no_grad()
def test_no_thread_is_left_over(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    monkeypatch.setattr(torch, "get_num_threads", lambda: 7)
    monkeypatch.setattr(torch, "set_num_threads", told.append)
    together = threading.Barrier(MOST, timeout=300)
    on_all_cores(lambda part: together.wait(), range(MOST), CPU)
    assert sorted(told[:-1]) == [1, 2, 2, 2] and told[-1] == 7


@pytest.mark.usefixtures("two_threads")
@torch.no_grad()
def test_automatic_casting_comes_along() -> None:
    def product(part: int) -> torch.dtype:
        return (torch.ones(2, 2) @ torch.ones(2, 2)).dtype

    assert on_all_cores(product, [0, 1], CPU) == [torch.float32] * 2
    with torch.autocast("cpu", torch.bfloat16):
        assert on_all_cores(product, [0, 1], CPU) == [torch.bfloat16] * 2


@pytest.mark.usefixtures("two_threads")
@torch.no_grad()
def test_a_picture_on_two_cores_is_the_same(
    scene: "ToyScene", monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, scale = scene.camera, 3
    K = camera.K * camera.K.new_tensor([[scale], [scale], [1]])
    width, height = camera.size
    large = Camera(K, camera.camera_from_body, (scale * width, scale * height))
    workers = set()
    locate = scene.method.locate

    def noted(*given: object) -> object:
        workers.add(threading.current_thread().name)
        return locate(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(scene.method, "locate", noted)
    pictures = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        options = RenderOptions(samples=48, pixel_tolerance=0.0)
        pictures.append(render(scene.method, scene.actor, scene.pose, large, options))
    alone, shared = pictures
    assert alone.counts.rays > 2 * RAYS_A_CORE
    assert len(workers) == 3
    assert shared.counts == alone.counts
    torch.testing.assert_close(shared.rgb, alone.rgb, atol=1e-6, rtol=0)
    torch.testing.assert_close(shared.alpha, alone.alpha, atol=1e-6, rtol=0)
    torch.testing.assert_close(shared.depth, alone.depth, atol=1e-5, rtol=0)
