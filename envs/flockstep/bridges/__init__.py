"""Bridges to other programs.

`ArduPilotBridge` lets ArduPilot fly the drones: it answers ArduPilot's software in the loop over UDP.
"""

from flockstep.bridges.ardupilot import ArduPilotBridge, PacketCounts

__all__ = ["ArduPilotBridge", "PacketCounts"]
