import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from reference_samples import START

from dqcontrol import algebra, references as r
from dqcontrol.experiments.spec.reference_spec import AnyReference
from dqcontrol.files.yaml_file import convert, parse_yaml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
YAML = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
KINDS = {struct.__struct_config__.tag: struct for struct in AnyReference.__args__}
del KINDS["object"]  # of references made in Python, which no file describes
MODIFIERS = {"repeat", "ramp", "corner_stops", "jerk_limits", "transform"}


def build(text):
    spec = convert("page", parse_yaml("page", text)["reference"], AnyReference)
    return spec.build(START, ROOT / "examples")


@pytest.mark.parametrize("text", YAML)
def test_yaml_means_a_motion(text):
    reference = build(text)
    rows = reference.samples(np.linspace(0.0, min(reference.duration, 100.0), 50))
    assert np.isfinite(rows).all()


def test_every_kind_and_modifier_has_an_example():
    examples = [yaml.safe_load(text)["reference"] for text in YAML]
    assert {example["kind"] for example in examples} == set(KINDS)
    assert set.union(*map(set, examples)) >= MODIFIERS
    for name in [*KINDS, *MODIFIERS]:
        assert f"[`{name}`]" in PAGE


def test_python_of_the_page_runs_from_top_to_bottom(monkeypatch):
    monkeypatch.chdir(ROOT)
    names = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(code, names)
    assert names["rows"].shape == (1200, 21)
    assert names["square"].corners.tolist() == [5.0, 8.0, 13.0, 16.0]
    assert r.Repeat(names["square"], 3).duration == 48.0
    assert names["limited"].duration == pytest.approx(5.2)


def test_points_file_of_the_page_is_one(tmp_path):
    text = re.search(r"```text\n(.*?)```", PAGE, re.DOTALL)
    assert text
    (tmp_path / "corner.csv").write_text(text[1])
    points = r.load_points(tmp_path / "corner.csv", START)
    assert points.duration == 4.0
    np.testing.assert_allclose(algebra.translation(points.samples([2.0])[0, :8]), [0.5, 0.1, 0.4], atol=1e-15)


def test_links_lead_somewhere():
    headings = {h.lower().replace(" ", "-") for h in re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)}
    assert set(re.findall(r"\(#([\w-]+)\)", PAGE)) <= headings
    for name in re.findall(r"\(([\w-]+\.md)\)", PAGE):
        assert (ROOT / "docs" / name).exists()


def test_every_reference_is_on_the_page():
    for name in r.__all__:
        if isinstance(getattr(r, name), type) and name not in ("DrawingFile", "Sample"):
            assert f"`{name}`" in PAGE or f"{name}(" in PAGE, name
