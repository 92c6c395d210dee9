"""Other hand detectors: how large an exported network is, how its boxes are read, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from app.evaluate.harness import EvaluateFault
from app.evaluate.loop.networks import NetworkSize, OnnxDetector, onnx_size
from app.evaluate.loop.speed import open_detectors
from app.system.errors import AppError

SIDE = 64
IMAGE = np.zeros((36, 128, 3), np.uint8)  # is shown at half its size


def saved(path: Path, outputs: dict[str, np.ndarray], *, first: tuple[int, ...] = (1, 3, SIDE, SIDE)) -> Path:
    """A model that gives these whatever it is shown."""
    element = TensorProto.UINT8 if first[-1] == 3 else TensorProto.FLOAT
    nodes = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value.astype(np.float32)))
        for name, value in outputs.items()
    ]
    given = [helper.make_tensor_value_info(name, TensorProto.FLOAT, one.shape) for name, one in outputs.items()]
    return write(path, nodes, [helper.make_tensor_value_info("images", element, first)], given)


def write(path: Path, nodes: list[Any], inputs: list[Any], outputs: list[Any], weights: tuple[Any, ...] = ()) -> Path:
    graph = helper.make_graph(nodes, "detector", inputs, outputs, list(weights))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.save(model, path)
    return path


# One hand about (32, 16) of the input, 16 wide and 8 high, again with a lower score, and one that is too unsure.
MIDDLES = np.array([(32, 16, 16, 8), (33, 16, 16, 8), (50, 50, 4, 4)], float)
CORNERS = np.array([(24, 12, 40, 20), (25, 12, 41, 20), (48, 48, 52, 52)], float)
SCORES = np.array([0.9, 0.6, 0.1])


def yolo_v5() -> dict[str, np.ndarray]:
    rows = np.zeros((1, 9, 7))
    rows[0, :3] = np.column_stack((MIDDLES, np.ones(3), SCORES, 0.5 * SCORES))
    return {"output0": rows}


def yolo_v8() -> dict[str, np.ndarray]:
    rows = np.zeros((1, 5, 9))
    rows[0, :, :3] = np.column_stack((MIDDLES, SCORES)).T
    return {"output0": rows}


def ssd_of_pixels() -> dict[str, np.ndarray]:
    return {"boxes": CORNERS, "labels": np.ones(3), "scores": SCORES}


def ssd_of_shares() -> dict[str, np.ndarray]:
    scores = np.stack((1 - SCORES, SCORES), axis=-1)
    return {"scores": scores[np.newaxis], "boxes": CORNERS[np.newaxis] / SIDE}


def ssd_of_tensorflow() -> dict[str, np.ndarray]:
    turned = CORNERS[:, [1, 0, 3, 2]] / SIDE
    return {"detection_boxes": turned[np.newaxis], "detection_scores": SCORES[np.newaxis], "num_detections": np.ones(1)}


@pytest.mark.parametrize("outputs", [yolo_v5(), yolo_v8(), ssd_of_pixels(), ssd_of_shares()])
def test_a_hand_is_found_once_where_the_image_has_it(tmp_path: Path, outputs: dict[str, np.ndarray]) -> None:
    boxes, scores = OnnxDetector(saved(tmp_path / "one.onnx", outputs)).detect(IMAGE)
    assert np.allclose(boxes, [(48, 24, 32, 16)], atol=1e-3)
    assert np.allclose(scores, [0.9])


def test_bytes_with_the_channels_last_are_taken_too(tmp_path: Path) -> None:
    model = saved(tmp_path / "one.onnx", ssd_of_tensorflow(), first=(1, SIDE, SIDE, 3))
    boxes, _ = OnnxDetector(model).detect(IMAGE)
    assert np.allclose(boxes, [(48, 24, 32, 16)], atol=1e-3)


def test_an_image_without_a_hand_gives_none(tmp_path: Path) -> None:
    empty = {"output0": np.zeros((1, 9, 7))}
    boxes, scores = OnnxDetector(saved(tmp_path / "one.onnx", empty)).detect(IMAGE)
    assert (boxes.shape, scores.shape) == ((0, 4), (0,))


@pytest.mark.parametrize(
    "outputs", [{"logits": np.zeros((1, 1000))}, {"a": np.zeros((1, 9, 7)), "b": np.zeros((1, 9, 7))}]
)
def test_other_outputs_are_refused_with_their_shapes(tmp_path: Path, outputs: dict[str, np.ndarray]) -> None:
    with pytest.raises(AppError) as refused:
        OnnxDetector(saved(tmp_path / "one.onnx", outputs))
    assert refused.value.code is EvaluateFault.ONNX_OUTPUTS
    assert all(f"{name} {list(one.shape)}" in str(refused.value.values["outputs"]) for name, one in outputs.items())


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", EvaluateFault.ONNX_UNREADABLE),
        (b"no model", EvaluateFault.ONNX_UNREADABLE),
        (None, EvaluateFault.FILE_UNREADABLE),
    ],
)
def test_a_file_that_is_no_model_is_refused(tmp_path: Path, content: bytes | None, code: EvaluateFault) -> None:
    path = tmp_path / "one.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(AppError) as refused:
        OnnxDetector(path)
    assert refused.value.code is code
    assert str(tmp_path) not in str(refused.value.values["detail"]), "the sentence names the file already"


def test_a_model_that_no_single_image_can_be_given_to_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    four = saved(tmp_path / "four.onnx", yolo_v8(), first=(4, 3, SIDE, SIDE))
    with pytest.raises(AppError) as refused:
        open_detectors([four])
    assert refused.value.code is EvaluateFault.ONNX_NOT_RUN
    assert refused.value.values["file"] == four


def test_two_models_of_one_file_name_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    both = [saved(folder / "one.onnx", yolo_v8()) for folder in (tmp_path, tmp_path / "other")]
    assert set(open_detectors(both)) == {str(path) for path in both}
    assert set(open_detectors(both[:1])) == {"one.onnx"}


def test_parameters_and_multiply_adds_are_those_of_the_graph(tmp_path: Path) -> None:
    kernels, matrix = np.zeros((8, 3, 3, 3), np.float32), np.zeros((8, 5), np.float32)
    nodes = [
        helper.make_node("Conv", ["images", "kernels"], ["maps"], pads=[1, 1, 1, 1]),
        helper.make_node("GlobalAveragePool", ["maps"], ["means"]),
        helper.make_node("Flatten", ["means"], ["flat"]),
        helper.make_node("MatMul", ["flat", "matrix"], ["output0"]),
    ]
    weights = (numpy_helper.from_array(kernels, "kernels"), numpy_helper.from_array(matrix, "matrix"))
    given = [helper.make_tensor_value_info("output0", TensorProto.FLOAT, (1, 5))]
    image = [helper.make_tensor_value_info("images", TensorProto.FLOAT, (1, 3, 10, 20))]
    path = write(tmp_path / "one.onnx", nodes, image, given, weights)
    assert onnx_size(path) == NetworkSize(8 * 27 + 40, 10 * 20 * 8 * 27 + 8 * 5)


def test_an_open_size_leaves_multiply_adds_unknown(tmp_path: Path) -> None:
    nodes = [helper.make_node("Conv", ["images", "kernels"], ["output0"])]
    weights = (numpy_helper.from_array(np.zeros((8, 3, 3, 3), np.float32), "kernels"),)
    image = [helper.make_tensor_value_info("images", TensorProto.FLOAT, (1, 3, "height", "width"))]
    given = [helper.make_tensor_value_info("output0", TensorProto.FLOAT, (1, 8, "h", "w"))]
    assert onnx_size(write(tmp_path / "one.onnx", nodes, image, given, weights)) == NetworkSize(216, None)
