import numpy as np
import pytest

from dqcontrol.plants.compliant.joint_columns import MEMORY, butterworth, filtered, rest


@pytest.mark.parametrize("cutoff", [1.0, 20.0, 80.0, 300.0])
def test_answers_as_scipys_butterworth_filter(cutoff):
    signal = pytest.importorskip("scipy.signal")
    values = np.random.default_rng(1).standard_normal(500)
    coefficients, memory = butterworth(cutoff, 1e-3), np.zeros(MEMORY)
    ours = [filtered(coefficients, memory, value) for value in values]
    theirs = signal.sosfilt(signal.butter(3, cutoff, fs=1000, output="sos"), values)
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_starts_at_rest_and_stays_there():
    coefficients, memory = butterworth(20.0, 1e-3), np.zeros(MEMORY)
    rest(coefficients, memory, 1.7)
    for _ in range(100):
        assert filtered(coefficients, memory, 1.7) == pytest.approx(1.7, abs=1e-13)
