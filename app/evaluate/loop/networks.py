"""How large a network is: parameters, and multiply-adds of one run, counted from its graph (Table 4)."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any


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
