"""Limits: what is done to a command before it leaves."""

from dqcontrol.limits.command_limits import CommandLimits

__all__ = ["CommandLimits"]
