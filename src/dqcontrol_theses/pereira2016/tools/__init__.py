"""Searches behind the printed numbers: `python -m dqcontrol_theses.pereira2016.tools.NAME`."""
