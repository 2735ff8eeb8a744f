"""Bridges to other programs.

`ArduPilotBridge` lets ArduPilot fly the drones: it answers ArduPilot's software in the loop over UDP.
`BetaflightBridge` starts Betaflight's firmware for each drone and flies in lockstep with it. `McapRecorder`
writes flights as ROS 2 messages to a file, from a `Batch`, an environment, the drones of a server (`ClientSource`), or
any other `Source`.
"""

from flockstep.bridges.ardupilot import ArduPilotBridge, PacketCounts
from flockstep.bridges.betaflight import BetaflightBridge
from flockstep.bridges.mcap import McapRecorder
from flockstep.bridges.source import BatchSource, ClientSource, Source

__all__ = [
    "ArduPilotBridge",
    "BatchSource",
    "BetaflightBridge",
    "ClientSource",
    "McapRecorder",
    "PacketCounts",
    "Source",
]
