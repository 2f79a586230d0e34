"""The examples of constraints: what is asked for is kept, the law alone would not, and the report says how it ended."""

from pathlib import Path

import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.reports.run_report import run_verdicts

EXAMPLES = Path(__file__).parents[2] / "examples"
CASES = {
    "keep-out": ("gave way to constraints", None),
    "door": ("reached", None),
    "drawing-around": ("reached", None),
    "lines-apart": ("not reached", "held"),
}


@pytest.mark.filterwarnings("ignore::dqcontrol.errors.TaskWarning")
@pytest.mark.parametrize("name", CASES)
def test_an_example_keeps_what_it_asks_for_and_says_what_became_of_its_task(name):
    task, deadlock = CASES[name]
    run = dqc.run(EXAMPLES / f"{name}.yaml")
    found = {row[0]: [str(cell) for cell in row[1:]] for row in run_verdicts(run, None).rows}
    assert found["Constraints"][0] == "no constraint crossed", found["Constraints"]
    assert found["Task"][0] == task, found["Task"]
    assert found.get("Deadlock", [None])[0] == deadlock

    if name == "keep-out":
        assert run.verdict.words == (
            "kept clear of the ball (10.8 mm, 10 asked); left the circle by 65 mm at most; back on it at the end"
        )
        assert not run.verdict.failure

    text = (EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8")
    text = text.replace("drawings/", f"{EXAMPLES}/drawings/")
    spec = yaml.safe_load(text)
    spec.pop("constraints")
    free = dqc.run(spec).record
    setting = prepare(EXAMPLES / f"{name}.yaml")
    (case,) = setting.cases
    kept = case.prepare_law(setting.spec).constraints
    assert kept is not None
    values = kept.values(free.q, free.time)
    assert (values - kept.asked).min() < -1e-3  # the law alone crosses
