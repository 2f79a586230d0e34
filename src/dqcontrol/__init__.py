"""Dual quaternion control laws for arms: compiled simulation, physics, experiments."""

import lazy_loader

from dqcontrol.experiments import result_pages as _result_pages
from dqcontrol.version import __version__ as __version__

# As in all packages: what is offered stands in `__init__.pyi`, and is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _report_pages() -> _result_pages.ResultPages:
    from dqcontrol.reports import report_writer

    return report_writer


_result_pages.hand_in(_report_pages)
