"""Constraints around laws; programs with constraints, and levels of rows that give way."""
