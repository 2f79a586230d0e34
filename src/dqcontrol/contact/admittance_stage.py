"""The contact stage at work, alone: for loops of one's own, and for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK
from dqcontrol.contact.admittance_step import felt_wrench
from dqcontrol.contact.contact_layout import ContactState, contact_state, contact_work
from dqcontrol.errors import DivergedError, as_positive
from dqcontrol.references.sample import SAMPLE_SIZE

if TYPE_CHECKING:
    from dqcontrol.contact.admittance import Admittance


class AdmittanceStage:
    """An admittance with its state.

    Parameters
    ----------
    admittance
        Its parameters.
    period
        T, s.

    Attributes
    ----------
    state
        See ``ContactState``.
    """

    state: ContactState

    def __init__(self, admittance: Admittance, period: float) -> None:
        self._step = admittance.kernel.compiled
        self._parameters = admittance.parameters(as_positive("period", period))
        self._state, self._work = np.zeros(contact_state.size()), np.zeros(contact_work.size())
        self.state = contact_state(self._state)
        self._k = 0

    def felt(self, pose: Array, wrench: Array) -> Array:
        """Return moment and force on the hand, shape (6,), along the axes of the base or its own, with nothing moved.

        Parameters
        ----------
        pose, wrench
            As for `step`; the tool's weight and bias, and what was tared, are taken off.
        """
        out = np.empty(6)
        felt_wrench(pose, self._parameters, wrench, self.state.tare, out)
        return out

    def step(self, pose: Array, sample: Array, wrench: Array) -> Array:
        """Return the sample (21,) that a law follows for one period.

        Parameters
        ----------
        pose
            Of the hand, measured, shape (8,).
        sample
            Desired, shape (21,): pose, twist, twist rate, time.
        wrench
            Force and torque at the sensor that tool and environment exert on the hand, its axes, shape (6,), N and N·m;
            NaN where it says nothing.

        Raises
        ------
        DivergedError
            If the result is not finite.
        """
        self._work[:6] = wrench
        out = self._work[6 : 6 + SAMPLE_SIZE]
        status = self._step(pose, sample, self._k, self._parameters, self._state, self._work)
        self._k += 1
        if status != OK:
            raise DivergedError("contact: the compliant frame is not finite")
        return out.copy()
