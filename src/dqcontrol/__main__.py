"""``python -m dqcontrol``."""

from dqcontrol.cli import main

main()
