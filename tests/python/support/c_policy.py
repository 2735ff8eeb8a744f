"""A header of `flockstep.export`, compiled, as functions of Python."""

import ctypes
import itertools
import subprocess

import numpy as np

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
_NUMBERS = itertools.count()  # a library that is loaded again under its name would be the earlier one


class CPolicy:
    """Acts by the header NAME.h, whose observations and actions have these numbers."""

    def __init__(self, header, observations, actions):
        name = header.stem
        source = header.with_suffix(".c")
        source.write_text(
            f'#include "{header.name}"\n'
            "void act(const float *observation, float *action, int rows) {\n"
            f"  for (int i = 0; i < rows; ++i) {name}_act(observation + i * {observations}, action + i * {actions});\n"
            "}\n"
            f"float self_test(void) {{ return {name}_self_test(); }}\n"
        )
        library = header.with_suffix(f".{next(_NUMBERS)}.so")
        subprocess.run(
            ["cc", "-std=c99", "-O2", *STRICT, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True
        )
        self._library, self._actions = ctypes.CDLL(str(library)), actions
        self._library.self_test.restype = ctypes.c_float

    def __call__(self, observations):
        rows = np.ascontiguousarray(observations, np.float32)
        actions = np.full((len(rows), self._actions), np.nan, np.float32)
        pointer = np.ctypeslib.ndpointer(np.float32, flags="C")
        self._library.act.argtypes = [pointer, pointer, ctypes.c_int]
        self._library.act(rows, actions, len(rows))
        return actions

    def self_test(self):
        return self._library.self_test()
