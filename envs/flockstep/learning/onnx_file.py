"""A policy as an ONNX model, by the onnx package."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from flockstep.learning.actor import Actor
from flockstep.learning.networks import (
    BLOB_SIZE,
    DIRECTION_GAIN,
    DIRECTION_SIZE,
    NEAR_POINT_M,
    NEAREST,
    OFFSET_GAIN,
    WIDTH_GAIN,
)

_OPSET, _IR_VERSION = 17, 8  # of 2022: runtimes since then read the file
_OPERATORS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


class _Graph:
    """Nodes and constants, each value under a name of its own."""

    def __init__(self, onnx: Any) -> None:
        self.onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any, dtype: Any = np.float32) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.asarray(values, dtype), name))
        return name

    def add(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        output = output or f"value_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, list(inputs), [output], **attributes))
        return output

    def split(self, value: str, *sizes: int) -> list[str]:
        names = [f"value_{len(self.nodes)}_{i}" for i in range(len(sizes))]
        given = [value, self.constant(sizes, np.int64)]
        self.nodes.append(self.onnx.helper.make_node("Split", given, names, axis=1))
        return names

    def cast(self, value: str, dtype: Any) -> str:
        return self.add("Cast", value, to=self.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(dtype)))


def onnx_file(actor: Actor, name: str, words: list[str]) -> bytes:
    """Return a model with the input "observation" (N, k) and the output "action": (N, m) float32, or (N,) int64.

    Raises
    ------
    ImportError
        The package onnx is not installed.
    """
    try:
        import onnx
        import onnx.helper
        import onnx.numpy_helper
    except ImportError as error:
        raise ImportError("export to .onnx needs onnx: pip install 'flockstep[onnx]'", name="onnx") from error
    graph = _Graph(onnx)
    value = _inputs(graph, actor)
    for layer in actor.layers:
        value = graph.add("Gemm", value, graph.constant(layer.weight), graph.constant(layer.bias), transB=1)
        if layer.activation:
            value = graph.add(_OPERATORS[layer.activation], value)
    if isinstance(actor.action_space, spaces.Discrete):
        best = graph.add("ArgMax", value, axis=1, keepdims=0)
        graph.add("Add", best, graph.constant(actor.first_choice, np.int64), output="action")
        made = onnx.helper.make_tensor_value_info("action", onnx.TensorProto.INT64, ["N"])
    else:
        low, high = (np.ravel(bound).astype(np.float32) for bound in (actor.action_space.low, actor.action_space.high))
        if actor.is_squashed:
            value = graph.add("Mul", value, graph.constant((high - low) / 2))
            value = graph.add("Add", value, graph.constant((high + low) / 2))
        value = graph.add("Max", value, graph.constant(low))
        graph.add("Min", value, graph.constant(high), output="action")
        made = onnx.helper.make_tensor_value_info("action", onnx.TensorProto.FLOAT, ["N", actor.action_size])
    given = onnx.helper.make_tensor_value_info("observation", onnx.TensorProto.FLOAT, ["N", actor.observation_size])
    described = onnx.helper.make_graph(graph.nodes, name, [given], [made], graph.constants, doc_string="\n".join(words))
    opset = onnx.helper.make_opsetid("", _OPSET)
    model = onnx.helper.make_model(described, producer_name="flockstep", opset_imports=[opset], ir_version=_IR_VERSION)
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def _inputs(graph: _Graph, actor: Actor) -> str:
    """Add what makes the first layer's inputs from an observation."""
    value, size = "observation", actor.observation_size
    if actor.normalization is not None:
        known = actor.normalization
        value = graph.add("Sub", graph.cast(value, np.float64), graph.constant(known.center, np.float64))
        value = graph.cast(graph.add("Div", value, graph.constant(known.deviation, np.float64)), np.float32)
        value = graph.add("Clip", value, graph.constant(-known.limit), graph.constant(known.limit))

    def near(ranges: str) -> str:
        return graph.add("Neg", graph.add("Log", graph.add("Add", ranges, graph.constant(NEAREST))))

    def times(factor: float, part: str) -> str:
        return graph.add("Mul", part, graph.constant(factor))

    if actor.features == "goal":
        direction, ranges = graph.split(value, DIRECTION_SIZE, size - DIRECTION_SIZE)
        return graph.add("Concat", times(DIRECTION_GAIN, direction), near(ranges), axis=1)
    if actor.features == "blob":
        offset, area, ranges = graph.split(value, 1, BLOB_SIZE - 1, size - BLOB_SIZE)
        is_there = graph.cast(graph.add("Greater", area, graph.constant(0.0)), np.float32)
        blob = [times(OFFSET_GAIN, offset), times(WIDTH_GAIN, graph.add("Sqrt", area)), is_there]
        return graph.add("Concat", *blob, near(ranges), axis=1)
    if actor.features == "point":
        way, _ = graph.split(value, DIRECTION_SIZE, size - DIRECTION_SIZE)
        far = graph.add("Add", graph.add("ReduceL2", way, axes=[1], keepdims=1), graph.constant(NEAR_POINT_M))
        return graph.add("Concat", graph.add("Div", way, far), value, axis=1)
    return value
