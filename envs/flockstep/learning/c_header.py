"""A policy as a C header."""

from __future__ import annotations

import re
import textwrap

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep.learning.actor import Actor, parts_of
from flockstep.learning.networks import (
    BLOB_SIZE,
    DIRECTION_GAIN,
    DIRECTION_SIZE,
    NEAR_POINT_M,
    NEAREST,
    OFFSET_GAIN,
    WIDTH_GAIN,
)

_CASES = 4  # observations of the self test


def c_header(actor: Actor, name: str, words: list[str]) -> str:
    """Return a header whose names begin with ``name``, and whose comment has these lines."""
    observations = _cases(actor)
    size, count, guard = actor.observation_size, actor.action_size, f"{name.upper()}_H"
    comment = "\n".join(
        wrapped
        for line in [f"{name}: a trained policy. {words[0]}", *words[1:]]
        for wrapped in textwrap.wrap(_plain(line), 110, subsequent_indent=" " * 11 * line.startswith(" ")) or [""]
    )
    activations = {layer.activation for layer in actor.layers}
    widths = [actor.layers[0].weight.shape[1], *(len(layer.bias) for layer in actor.layers)]
    body = [f"  float a[{max(widths[::2])}], b[{max(widths[1::2])}];", *_c_inputs(actor, name)]
    constants = []
    for i, layer in enumerate(actor.layers):
        constants += [_c_array(f"{name}_weight_{i}", layer.weight), _c_array(f"{name}_bias_{i}", layer.bias)]
        given, made = "ab" if i % 2 == 0 else "ba"
        body.append(
            f"  {name}_layer({name}_weight_{i}, {name}_bias_{i}, {given}, {layer.weight.shape[1]}, {made}, "
            f"{len(layer.bias)});"
        )
        if layer.activation:
            body.append(
                f"  for (int i = 0; i < {len(layer.bias)}; ++i) {made}[i] = {name}_{layer.activation}({made}[i]);"
            )
    out = "ab"[len(actor.layers) % 2]
    if actor.normalization is not None:
        mean = actor.normalization.center
        near = mean.astype(np.float32)
        constants += [
            _c_array(f"{name}_mean", near),
            _c_array(f"{name}_mean_rest", mean - near),  # together as exact as Python's double precision
            _c_array(f"{name}_deviation", actor.normalization.deviation),
        ]
    if isinstance(actor.action_space, spaces.Discrete):
        body += [
            "  int best = 0;",
            f"  for (int i = 1; i < {len(actor.layers[-1].bias)}; ++i) best = {out}[i] > {out}[best] ? i : best;",
            f"  action[0] = (float)(best + {actor.first_choice});",
        ]
    else:
        low, high = (np.ravel(bound).astype(np.float32) for bound in (actor.action_space.low, actor.action_space.high))
        constants += [_c_array(f"{name}_low", low), _c_array(f"{name}_high", high)]
        value = f"{out}[i]"
        if actor.is_squashed:
            value = f"{name}_low[i] + 0.5f * ({value} + 1.0f) * ({name}_high[i] - {name}_low[i])"
        body += [
            f"  for (int i = 0; i < {count}; ++i) {{",
            f"    const float x = {value};",
            f"    action[i] = x < {name}_low[i] ? {name}_low[i] : x > {name}_high[i] ? {name}_high[i] : x;",
            "  }",
        ]
    functions = [text.replace("NAME", name) for kind, text in _C_ACTIVATIONS.items() if kind in activations]
    tests = [
        _c_array(f"{name}_test_observation", observations),
        _c_array(f"{name}_test_action", actor.predict(observations)),
    ]
    return _C.format(
        comment=comment.replace("*/", "* /"),
        guard=guard,
        name=name,
        size=size,
        count=count,
        cases=_CASES,
        nan="the first choice" if isinstance(actor.action_space, spaces.Discrete) else "NaN",
        constants="\n".join(constants),
        functions="".join(functions),
        body="\n".join(body),
        tests="\n".join(tests),
    )


_C = """/*
{comment}

{name}_act computes an action from an observation, both as listed above. NaN in an observation gives {nan}.
{name}_self_test returns the largest difference from actions that Python computed: about 1e-6 is rounding.
*/
#ifndef {guard}
#define {guard}

#include <math.h>

{constants}

static inline void {name}_layer(const float *weight, const float *bias, const float *in, int inputs, float *out,
                                int outputs) {{
  for (int i = 0; i < outputs; ++i, weight += inputs) {{
    float sum = bias[i];
    for (int j = 0; j < inputs; ++j) sum += weight[j] * in[j];
    out[i] = sum;
  }}
}}
{functions}
static inline void {name}_act(const float observation[{size}], float action[{count}]) {{
{body}
}}

{tests}

static inline float {name}_self_test(void) {{
  float worst = 0.0f;
  for (int i = 0; i < {cases}; ++i) {{
    float action[{count}];
    {name}_act({name}_test_observation + i * {size}, action);
    for (int j = 0; j < {count}; ++j) {{
      const float off = fabsf(action[j] - {name}_test_action[i * {count} + j]);
      if (!(off <= worst)) worst = off; /* also NaN */
    }}
  }}
  return worst;
}}

#endif
"""

_C_ACTIVATIONS = {
    "tanh": "\nstatic inline float NAME_tanh(float x) { return tanhf(x); }\n",
    "relu": "\nstatic inline float NAME_relu(float x) { return x < 0.0f ? 0.0f : x; }\n",
    "elu": "\nstatic inline float NAME_elu(float x) { return x < 0.0f ? expm1f(x) : x; }\n",
}


def _plain(text: str) -> str:
    """Return words in ASCII, without quotes of names."""
    return re.sub(r"``|`", "", text).replace("±", "+-").encode("ascii", "replace").decode()


def _c_inputs(actor: Actor, name: str) -> list[str]:
    """Return the lines that write the first layer's inputs to a."""
    size, given = actor.observation_size, "observation"
    lines = []
    if actor.normalization is not None:
        given, limit = "o", f"{actor.normalization.limit}f"
        lines += [
            f"  float o[{size}];",
            f"  for (int i = 0; i < {size}; ++i) {{",
            f"    const float x = (observation[i] - {name}_mean[i] - {name}_mean_rest[i]) / {name}_deviation[i];",
            f"    o[i] = x < -{limit} ? -{limit} : x > {limit} ? {limit} : x;",
            "  }",
        ]
    d, near = DIRECTION_SIZE, f"-logf({given}[i] + {NEAREST}f)"
    if actor.features == "goal":
        lines.append(f"  for (int i = 0; i < {size}; ++i) a[i] = i < {d} ? {DIRECTION_GAIN}f * {given}[i] : {near};")
    elif actor.features == "blob":
        lines += [
            f"  a[0] = {OFFSET_GAIN}f * {given}[0];",
            f"  a[1] = {WIDTH_GAIN}f * sqrtf({given}[1]);",
            f"  a[2] = {given}[1] > 0.0f ? 1.0f : 0.0f;",
            f"  for (int i = {BLOB_SIZE}; i < {size}; ++i) a[i + 1] = {near};",
        ]
    elif actor.features == "point":
        squares = " + ".join(f"{given}[{i}] * {given}[{i}]" for i in range(d))
        lines += [
            f"  const float far = sqrtf({squares}) + {NEAR_POINT_M}f;",
            f"  for (int i = 0; i < {d}; ++i) a[i] = {given}[i] / far;",
            f"  for (int i = 0; i < {size}; ++i) a[i + {d}] = {given}[i];",
        ]
    else:
        lines.append(f"  for (int i = 0; i < {size}; ++i) a[i] = {given}[i];")
    return lines


def _cases(actor: Actor) -> npt.NDArray[np.float32]:
    """Return observations as in flights, as far as the spaces and the normalization tell, for the self test."""
    drawn = np.random.default_rng(0).uniform(-2.0, 2.0, (_CASES, actor.observation_size))
    if actor.normalization is not None:
        drawn = actor.normalization.center + actor.normalization.deviation * drawn
    parts = [part for _, part in parts_of(actor.observation_space) if isinstance(part, spaces.Box)]
    lowest = np.concatenate([part.low.ravel() for part in parts])
    drawn = np.clip(drawn, lowest, np.concatenate([part.high.ravel() for part in parts]))
    if actor.features in ("goal", "blob"):  # ranges are not negative, nor is the area of a blob
        drawn[:, 1:] = np.abs(drawn[:, 1:])
    return drawn.astype(np.float32)


def _c_array(name: str, values: npt.ArrayLike) -> str:
    flat = np.ravel(np.asarray(values, np.float32))
    texts = [{"inf": "INFINITY", "-inf": "-INFINITY"}.get(str(value), f"{value!s}f") for value in flat]
    lines = ",\n".join("  " + ", ".join(texts[i : i + 6]) for i in range(0, len(texts), 6))
    return f"static const float {name}[{len(flat)}] = {{\n{lines}\n}};"
