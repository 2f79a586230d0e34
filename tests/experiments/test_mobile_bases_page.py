"""The Python of docs/mobile-bases.md prints what it says."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs/mobile-bases.md").read_text()


def test_a_base_goes_under_any_arm_of_a_file(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(code, "page", "exec"), {"__name__": "__main__"})
    (promised,) = re.findall(r"print\(.*\) +# (.*)", code)
    assert capsys.readouterr().out.strip() == promised
