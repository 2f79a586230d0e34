"""What counts as one stop request, and what as a second one."""

import signal
import sys

import pytest

from dqcontrol.loop.interrupts import counted_interrupts, first_interrupt

if sys.platform == "win32":
    pytest.skip("Windows hangs nothing up", allow_module_level=True)


def test_a_terminal_that_has_gone_is_one_stop_request_however_often_it_is_said():
    with counted_interrupts() as interrupts:
        interrupts.only_count()
        for _ in range(4):
            signal.raise_signal(signal.SIGHUP)
        assert interrupts.count == 1
        signal.raise_signal(signal.SIGTERM)
        assert interrupts.count == 2
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_a_second_interrupt_breaks_off_what_the_first_one_stops_but_a_second_hang_up_does_not():
    stops = []
    with first_interrupt(lambda: stops.append("softly")):
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        assert stops == ["softly"]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    assert stops == ["softly"]
