"""Rows of the parameters of drones, and variations that give them."""

import numpy as np

from flockstep import DroneParameters, Variation, parameter_names

FIELDS = tuple(DroneParameters.__match_args__)
LATE = [f"rotor_thrust_scale[{k}]" for k in range(4, 8)]


def columns(field):
    """Indices of the floats of a field, of a quadrotor."""
    return [i for i, name in enumerate(parameter_names) if name.partition("[")[0] == field and name not in LATE]


def defaults():
    return np.concatenate([np.atleast_1d(np.float32(getattr(DroneParameters(), name))) for name in FIELDS])


def row(**values):
    """The parameters (P,) of a drone."""
    params = defaults()
    for field, value in values.items():
        params[columns(field)] = value
    return params


def constants(**values):
    """Variations that give each drone these values."""
    return [
        Variation(parameter=parameter_names[i], low=v, high=v)
        for field, value in values.items()
        for i, v in zip(columns(field), np.broadcast_to(value, len(columns(field))).tolist(), strict=True)
    ]
