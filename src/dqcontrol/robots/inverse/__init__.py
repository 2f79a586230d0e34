"""Inverse kinematics of chains and trees."""
