"""Networks of hand detectors (Table 4): how large they are, and any exported to ONNX run beside MediaPipe.

Parameters, and the multiply-adds of one run, are counted from a network's graph. Of an ONNX export (YOLOv5, YOLOv8,
SSD), which one it is follows from what it gives:

| export | outputs |
|---|---|
| YOLOv5 | one (1, boxes, 5 + classes): middle and size in pixels of the input, object score, class scores |
| YOLOv8 | one (1, 4 + classes, boxes): middle and size in pixels of the input, class scores |
| SSD | two named …boxes and …scores; boxes are corners as shares of the input (`detection_boxes`: y before x), or \
pixels; scores with a last axis of classes begin with the background |
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from app.evaluate.harness import EvaluateFault
from app.system.errors import AppError
from kgdfa.hand import FloatArray
from kgdfa.preprocess import Image
from logs.reading.errors import cause_of

OPEN_SIDE_PX = 640  # of an input whose size the model leaves open: YOLO's usual one
LEAST_SCORE = 0.25  # YOLO's usual one
MOST_OVERLAP = 0.45
GREY = (114, 114, 114)  # what YOLO fills the rest of a square input with


@dataclass(frozen=True, slots=True)
class NetworkSize:
    """multiply_adds: of its convolutions and matrix products in one run; None where a shape is open."""

    parameters: int
    multiply_adds: int | None


def bundle_sizes(model: Path) -> dict[str, NetworkSize]:
    """Of every TensorFlow Lite network in a MediaPipe task bundle, by its name there."""
    with zipfile.ZipFile(model) as bundle:
        names = [name for name in bundle.namelist() if name.endswith(".tflite")]
        return {name.removesuffix(".tflite"): _tflite_size(bundle.read(name)) for name in names}


def _tflite_size(data: bytes) -> NetworkSize:
    import tflite

    network = tflite.Model.GetRootAs(data, 0)
    graph = network.Subgraphs(0)
    tensors = [graph.Tensors(number) for number in range(graph.TensorsLength())]
    constants = (one for one in tensors if network.Buffers(one.Buffer()).DataLength())
    parameters = sum(math.prod(_shape(one)) for one in constants)
    return NetworkSize(parameters, sum(_tflite_multiply_adds(network, graph, tensors)))


def _tflite_multiply_adds(network: Any, graph: Any, tensors: list[Any]) -> Iterator[int]:
    from tflite.BuiltinOperator import BuiltinOperator

    # The weights' axes that an output element sums over: (out, height, width, in), (1, height, width, out), (out, in).
    summed = {
        BuiltinOperator.CONV_2D: (1, 2, 3),
        BuiltinOperator.DEPTHWISE_CONV_2D: (1, 2),
        BuiltinOperator.FULLY_CONNECTED: (1,),
    }
    for number in range(graph.OperatorsLength()):
        operator = graph.Operators(number)
        code = network.OperatorCodes(operator.OpcodeIndex())
        axes = summed.get(max(code.BuiltinCode(), code.DeprecatedBuiltinCode()))
        if axes is not None:
            weights = _shape(tensors[operator.Inputs(1)])
            yield math.prod(_shape(tensors[operator.Outputs(0)])) * math.prod(weights[axis] for axis in axes)


def _shape(tensor: Any) -> list[int]:
    return [tensor.Shape(axis) for axis in range(tensor.ShapeLength())]


def onnx_size(path: Path) -> NetworkSize:
    """Of an ONNX model, whose images are taken one at a time. Raises whatever `onnx` does for a file that is none."""
    import onnx

    model = onnx.shape_inference.infer_shapes(onnx.load(path))
    weights = {one.name: tuple(one.dims) for one in model.graph.initializer}
    shapes = weights | {one.name: _onnx_shape(one) for one in (*model.graph.value_info, *model.graph.output)}
    products = (node for node in model.graph.node if node.op_type in {"Conv", "Gemm", "MatMul"})
    counts = [_onnx_multiply_adds(node, shapes) for node in products]
    known = [count for count in counts if count is not None]
    parameters = sum(math.prod(shape) for shape in weights.values())
    return NetworkSize(parameters, sum(known) if len(known) == len(counts) else None)


def _onnx_shape(value: Any) -> tuple[int, ...]:
    """Its axes; the first, open one is the number of images. An axis that is open elsewhere is 0."""
    sizes = [axis.dim_value for axis in value.type.tensor_type.shape.dim]
    return (sizes[0] or 1, *sizes[1:]) if sizes else ()


def _onnx_multiply_adds(node: Any, shapes: dict[str, tuple[int, ...]]) -> int | None:
    out, weights = shapes.get(node.output[0], ()), shapes.get(node.input[1], ())
    if not out or not weights or not all((*out, *weights)):
        return None
    transposed = any(one.name == "transB" and one.i for one in node.attribute)
    summed = weights[1:] if node.op_type == "Conv" else weights[-1:] if transposed else weights[-2:-1]
    return math.prod(out) * math.prod(summed)


def first_line(error: Exception) -> str:
    """What a library says, which may go on for pages or be nothing, without its own numbers and the path again."""
    text = next(iter(str(error).splitlines()), "")
    return text.rpartition(" failed:")[2].strip(" .") or type(error).__name__


class Export(Enum):
    """How a model's outputs are read."""

    YOLO_V5 = auto()
    YOLO_V8 = auto()
    SSD = auto()


class OnnxDetector:
    """Runs a model on images of any size."""

    def __init__(self, path: Path) -> None:
        """Raises AppError when it can't be read or run, or is no ONNX model whose input and outputs are known here."""
        import onnxruntime

        try:
            with path.open("rb"):
                pass
        except OSError as error:
            raise AppError(EvaluateFault.FILE_UNREADABLE, file=path, detail=cause_of(error)) from error
        try:
            self._session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        except Exception as error:  # the library's own kinds of error have no common base
            raise AppError(EvaluateFault.ONNX_UNREADABLE, file=path, detail=first_line(error)) from error
        (first, *others) = self._session.get_inputs()
        outputs = {one.name: tuple(one.shape) for one in self._session.get_outputs()}
        export = export_of(outputs)
        if export is None or others or len(first.shape) != 4 or 3 not in {first.shape[1], first.shape[3]}:
            shapes = ", ".join(f"{name} {list(shape)}" for name, shape in outputs.items())
            raise AppError(EvaluateFault.ONNX_OUTPUTS, file=path, outputs=shapes)
        self._export, self._names = export, list(outputs)
        self._input, self._channels_first = first.name, first.shape[1] == 3
        self._bytes = first.type == "tensor(uint8)"
        height, width = first.shape[2:] if self._channels_first else first.shape[1:3]
        self.size = tuple(side if isinstance(side, int) else OPEN_SIDE_PX for side in (width, height))
        try:  # now, and not after the other detectors were measured
            self.detect(np.zeros((*self.size[::-1], 3), np.uint8))
            self.network = onnx_size(path)
        except Exception as error:  # whatever a foreign model makes the library do
            raise AppError(EvaluateFault.ONNX_NOT_RUN, file=path, detail=first_line(error)) from error

    def detect(self, image_bgr: Image) -> tuple[FloatArray, FloatArray]:
        """(n, 4) boxes in the image, left, top, width, height in pixels, and their (n,) scores, surest first."""
        shown, scale = _letterbox(image_bgr, self.size)
        pixels = cv2.cvtColor(shown, cv2.COLOR_BGR2RGB)
        given = pixels if self._bytes else pixels.astype(np.float32) / 255
        given = given.transpose(2, 0, 1) if self._channels_first else given
        found = self._session.run(None, {self._input: given[np.newaxis]})
        corners, scores = decode(self._export, dict(zip(self._names, found, strict=True)), self.size)
        boxes = np.hstack((corners[:, :2], corners[:, 2:] - corners[:, :2])) / scale
        kept = np.asarray(cv2.dnn.NMSBoxes(boxes.tolist(), scores.tolist(), LEAST_SCORE, MOST_OVERLAP), np.intp)
        return boxes[kept], scores[kept]


def export_of(outputs: Mapping[str, tuple[int | str | None, ...]]) -> Export | None:
    """Which export gives outputs of these shapes; None for one that is not known here."""
    if all(any(name.endswith(part) for name in outputs) for part in ("boxes", "scores")):
        return Export.SSD
    (shape,) = outputs.values() if len(outputs) == 1 else ((),)
    if len(shape) != 3:
        return None
    many, few = (side if isinstance(side, int) else None for side in shape[1:])
    if few is not None and few > 5 and (many is None or many > few):
        return Export.YOLO_V5
    return Export.YOLO_V8 if many is not None and many > 4 and (few is None or few > many) else None


def decode(export: Export, outputs: Mapping[str, Any], size: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """(n, 4) corners, left, top, right, bottom in pixels of the input, and (n,) scores."""
    if export is Export.SSD:
        return _decode_ssd(outputs, size)
    (rows,) = outputs.values()
    rows = np.asarray(rows[0] if export is Export.YOLO_V5 else rows[0].T, np.float64)
    scores = rows[:, 4] * rows[:, 5:].max(axis=1) if export is Export.YOLO_V5 else rows[:, 4:].max(axis=1)
    middle, half = rows[:, :2], rows[:, 2:4] / 2
    return np.hstack((middle - half, middle + half)), scores


def _decode_ssd(outputs: Mapping[str, Any], size: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    name, boxes = next((name, one) for name, one in outputs.items() if name.endswith("boxes"))
    scores = next(np.asarray(one, np.float64) for name, one in outputs.items() if name.endswith("scores"))
    corners: FloatArray = np.asarray(boxes, np.float64).reshape(-1, 4)
    if name == "detection_boxes":  # TensorFlow's
        corners = corners[:, [1, 0, 3, 2]]
    if corners.size and np.abs(corners).max() <= 2:  # shares of the input, of which a box may stick out
        corners = corners * (*size, *size)
    return corners, scores[..., 1:].max(axis=-1).reshape(-1) if scores.ndim == 3 else scores.reshape(-1)


def _letterbox(image: Image, size: tuple[int, ...]) -> tuple[Image, float]:
    """The image at the input's left and top, as large as fits, and its scale."""
    height, width = image.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    small = cv2.resize(image, (round(scale * width), round(scale * height)), interpolation=cv2.INTER_LINEAR)
    right, bottom = size[0] - small.shape[1], size[1] - small.shape[0]
    shown = cv2.copyMakeBorder(small, 0, bottom, 0, right, cv2.BORDER_CONSTANT, value=GREY)
    return np.asarray(shown, np.uint8), scale
