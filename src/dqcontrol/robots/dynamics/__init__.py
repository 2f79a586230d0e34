"""Dynamics of chains and trees of rigid bodies, compiled."""
