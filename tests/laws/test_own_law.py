"""Users' own laws and plants: compiled where possible, interpreted with a warning where not, equal either way."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.compiled.compile import InterpretedKernel, Kernel
from dqcontrol.errors import DivergedError, Error, InterpretedWarning, ShapeError
from dqcontrol.laws import OwnLaw, Proportional
from dqcontrol.plants import Integrator, OwnPlant

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]


def transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    state[0] += 1.0
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])


def transpose_not_compilable(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    _ = "".join(str(type(object())))  # no compiled code for this
    transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out)


def hopeless(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = np.nan if sample[20] > 0.05 else 0.0


def noisy(command, parameters, noise, state, q, measured):
    state[0] += 1.0
    for i in range(q.shape[0]):
        q[i] += parameters[0] * command[i]
        measured[i] = q[i] + parameters[1] * noise[i]


def noisy_not_compilable(command, parameters, noise, state, q, measured):
    _ = "".join(str(type(object())))
    noisy(command, parameters, noise, state, q, measured)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def run(arm, law, plant, interpreted=False):
    circle = dqc.references.Circle(arm.fkm(START), radius=0.05, duration=1.0)
    return dqc.simulate(arm, circle, law, plant, START, 0.01, interpreted=interpreted, seed=3)


def test_a_law_that_compiles_runs_in_the_rollout_and_equals_its_python(arm):
    law = OwnLaw(function=transpose, parameters=[20.0])
    assert isinstance(law.kernel, Kernel)
    compiled, interpreted = (run(arm, law, Integrator(), mode) for mode in (False, True))
    assert np.array_equal(compiled.q, interpreted.q)
    with pytest.warns(InterpretedWarning, match="transpose_not_compilable: does not compile"):
        python = run(arm, OwnLaw(function=transpose_not_compilable, parameters=[20.0]), Integrator())
    np.testing.assert_allclose(python.q, compiled.q, rtol=0, atol=1e-14)


def test_a_law_that_does_not_compile_is_interpreted():
    law = OwnLaw(function=transpose_not_compilable, parameters=[1.0])
    assert isinstance(law.kernel, InterpretedKernel)


def test_a_law_whose_bytecode_numba_cannot_read_is_interpreted(arm):
    """Keyword arguments in a dictionary: Numba raises what is none of its own errors."""

    def with_options(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        options = {"axis": 0}
        out[:] = np.sum(np.zeros((2, out.shape[0])), **options, keepdims=False)

    with pytest.warns(InterpretedWarning, match="with_options: does not compile"):
        u = OwnLaw(function=with_options).command(arm, START, dqc.Sample(arm.fkm(START)), 0.01)
    assert not u.any()


def test_own_plants(arm):
    law = Proportional(gain=10.0)
    compiled = run(arm, law, OwnPlant(function=noisy, parameters=[1e-4], noise=7))
    with pytest.warns(InterpretedWarning, match="noisy_not_compilable: does not compile"):
        python = run(arm, law, OwnPlant(function=noisy_not_compilable, parameters=[1e-4], noise=7))
    np.testing.assert_allclose(python.q, compiled.q, rtol=0, atol=1e-13)
    assert 0.5e-4 < (compiled.measured - compiled.q)[1:].std() < 2e-4
    silent = run(arm, law, OwnPlant(function=noisy, parameters=[0.0], noise=7))
    np.testing.assert_allclose(silent.q, run(arm, law, Integrator()).q, rtol=0, atol=1e-13)


def test_a_law_that_fails_ends_the_run_and_says_when(arm):
    record = run(arm, OwnLaw(function=hopeless), Integrator())
    assert record.stopped.startswith("diverged at 0.06 s")
    assert np.isfinite(record.command).all()


def forgetful(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    out[0] = 0.0


@pytest.mark.parametrize("interpreted", [False, True])
def test_inputs_that_a_law_does_not_write_end_the_run(arm, interpreted):
    """Otherwise joints would get whatever was in memory there."""
    with pytest.raises(DivergedError, match=r"^diverged at 0 s: the command is not finite"):
        run(arm, OwnLaw(function=forgetful), Integrator(), interpreted)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"function": 3},
            "function: expected a function, or its place as FILE.py:NAME or MODULE:NAME, got 3",
        ),
        ({"function": transpose, "parameters": [np.nan]}, r"parameters\[0\]: must be finite"),
    ],
)
def test_bad_laws(arm, fields, message):
    with pytest.raises(Error, match=message):
        OwnLaw(**fields).prepare(arm, None, 0.01)


def test_bad_plant(arm):
    with pytest.raises(Error, match="function: expected a function, or its place"):
        OwnPlant(function="x").start(arm, np.array(START), 0.01, 1, 0)


def stopping(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = 0.1
    if sample[20] > 0.5:
        raise ValueError("safety stop")


@pytest.mark.parametrize("interpreted", [False, True])
def test_an_exception_in_a_compiled_law_ends_the_run(arm, interpreted):
    record = run(arm, OwnLaw(function=stopping), Integrator(), interpreted)
    assert record.stopped.startswith(
        "diverged at 0.51 s: function: stopping raised ValueError: safety stop (test_own"
    )
    assert len(record) == 51


@pytest.mark.parametrize("interpreted", [False, True])
def test_what_a_law_raised_is_said_of_a_supervised_run_too(arm, interpreted):
    """It brakes, and says why the command was not finite."""
    still = dqc.references.SetPoint(arm.fkm(np.array(START)))
    law, supervisor = OwnLaw(function=stopping), dqc.supervisor.Supervisor()
    record = dqc.simulate(
        arm, still, law, Integrator(), START, 0.01, 1.0, supervisor=supervisor, interpreted=interpreted
    )
    why = "stop category 2: command not finite: function: stopping raised ValueError: safety stop"
    assert record.stopped.startswith(f"halted at {record.time[-1]:g} s: {why}")


def falling(command, parameters, noise, state, q, measured):
    if q[0] > 0.02:
        raise ValueError("fell")
    q[0] += 0.001


@pytest.mark.parametrize("interpreted", [False, True])
def test_a_plant_that_raises_is_not_said_to_produce_nan(arm, interpreted):
    record = run(arm, OwnLaw(function=gentle), OwnPlant(function=falling), interpreted)
    assert "s: function: falling raised ValueError: fell (test_own_law.py, line " in record.stopped


def gentle(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = 0.1


def beyond(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = parameters[i]  # of which there are three


def test_a_compiled_law_that_reads_beyond_an_array_ends_the_run(arm):
    with pytest.raises(Error, match="diverged at 0 s: function: beyond raised IndexError"):
        run(arm, OwnLaw(function=beyond, parameters=[0.1, 0.1, 0.1]), Integrator())


def four_arguments(q, pose, sample, out):
    out[:] = 0.0


def test_a_function_with_other_arguments_is_refused_in_a_line(arm):
    expected = (
        r"four_arguments\(q, pose, sample, out\) has to take 9 arguments: q, pose, pose_jacobian, .*, out$"
    )
    with pytest.raises(ShapeError, match=expected):
        OwnLaw(function=four_arguments).prepare(arm, None, 0.01)
    with pytest.raises(
        ShapeError, match=r"has to take 6 arguments: command, parameters, noise, state, q, measured$"
    ):
        OwnPlant(function=four_arguments).start(arm, np.array(START), 0.01, 1, 0)
    OwnLaw(function=lambda *whatever: whatever[-1].fill(0.0)).prepare(arm, None, 0.01)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"memory": -1}, "memory: must be ≥ 0, got -1"),
        ({"scratch": "a"}, "scratch: expected a whole number, got text 'a'"),
        ({"parameters": [[1.0]]}, r"parameters\[0\]: expected a number, got a list"),
    ],
)
def test_unfit_memory_and_parameters(parameters, message):
    with pytest.raises(Error, match=message):
        OwnLaw(function=transpose, **parameters)


def test_parameters_may_be_arrays(arm):
    law = OwnLaw(function=transpose, parameters=np.array([20.0, 1.0]))
    assert run(arm, law, Integrator()).stopped == "duration"
