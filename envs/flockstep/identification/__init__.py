"""Finds the numbers of a drone in logs of its flights, and tells how well they predict other flights.

``python -m flockstep identify`` does both. `read_table` and `read_flights` read logs, `fit` fits the flight model,
`drone_data` makes a drone file, `report` and `plot` show the result, and `predict` flies logged commands in the engine.
"""

from flockstep.identification.drone_file import drone_data
from flockstep.identification.fit import Fit, fit
from flockstep.identification.flights import Flight, flights_of, read_flights
from flockstep.identification.model import Parameters
from flockstep.identification.prediction import Errors, linear_map, predict, thrust_map
from flockstep.identification.reading import Table, read_table
from flockstep.identification.report import plot, report

__all__ = [
    "Errors",
    "Fit",
    "Flight",
    "Parameters",
    "Table",
    "drone_data",
    "fit",
    "flights_of",
    "linear_map",
    "plot",
    "predict",
    "read_flights",
    "read_table",
    "report",
    "thrust_map",
]
