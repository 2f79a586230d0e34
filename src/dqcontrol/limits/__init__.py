"""Limits: what is done to a command before it leaves."""

from dqcontrol.limits.clamping import ModifiedClamping, OriginalClamping
from dqcontrol.limits.command_limits import CommandLimits
from dqcontrol.limits.weighted_least_norm import WeightedLeastNorm

__all__ = ["CommandLimits", "ModifiedClamping", "OriginalClamping", "WeightedLeastNorm"]
