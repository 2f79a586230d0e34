"""Kinematics of chains and trees: poses, Jacobians and their rates, compiled."""
