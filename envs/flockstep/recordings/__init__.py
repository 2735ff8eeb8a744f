"""Recorded flights as arrays: captured step by step, kept as MCAP files, shown as web pages."""

from flockstep.recordings.capture import Capture
from flockstep.recordings.recording import EpisodeEnding, Recording
from flockstep.recordings.writer import RecordingWriter

__all__ = ["Capture", "EpisodeEnding", "Recording", "RecordingWriter"]
