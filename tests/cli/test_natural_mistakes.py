"""What people get wrong at first, each answered by one line that leads on: no traceback, exit code 2."""

import pytest
import yaml
from test_cli import SPEC, call, here  # noqa: F401

K = {"kind": "proportional", "gain": 5}
CIRCLE = {"kind": "circle", "radius": 0.06, "duration": 4}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"law": "proportional"},
            "law: expected a mapping, got text 'proportional'; write {kind: proportional}",
        ),
        ({"plant": "servo"}, "plant: expected a mapping, got text 'servo'; write {kind: servo}"),
        ({"reference": "circle"}, "write {kind: circle}, with its other keys in it"),
        (
            {"law": None, "laws": [K]},
            "laws: expected a mapping, got a list; give each a name, as in {A: …, B: …}",
        ),
        ({"law": {"gain": 5}}, "law: missing key 'kind' (allowed: "),
        ({"law": {"type": "proportional", "gain": 5}}, "missing key 'kind'; write kind for 'type'"),
        (
            {"law": {**K, "gain": "five"}},
            "law.gain: expected a number or a mapping or a list, got text 'five'",
        ),
        ({"law": {**K, "gain": [1, 2, 3]}}, "gain: expected one number or 8, got shape (3,)"),
        ({"law": {"kind": "Proportional", "gain": 5}}, "did you mean 'proportional'?"),
        ({"law": {**K, "kp": 3}}, "unknown key 'kp'; did you mean 'gain'?"),
        ({"law": {"kind": "pid", "gain": 5}}, "law.kind: unknown name 'pid' (allowed: "),
        ({"start": "home"}, "start: expected a mapping or a list or nothing, got text 'home'"),
        ({"start": [0, 34, 0, 90, 0, 34, 0]}, "degrees? Angles are in rad; write 34 deg"),
        ({"reference": {**CIRCLE, "radius": 60}}, "metres? Write 60 mm for millimetres"),
        (
            {"reference": {**CIRCLE, "plane": "zx"}},
            "unknown name 'zx'; did you mean 'yz'? (allowed: xy, xz, yz)",
        ),
        ({"reference": {"kind": "set-point"}}, "a set-point has no duration; give 'duration'"),
        (
            {"reference": {"kind": "drawing", "file": "star.txt"}},
            "star.txt: no such file; did you mean 'stars.txt'?",
        ),
        ({"period": 8}, "period: 8 s is long for a period; write 8 ms or 8 s"),
        ({"period": "8"}, "period: expected a number, got text '8'"),
        ({"period": "10 milliseconds"}, "got text '10 milliseconds'; units: rad, mrad, deg, "),
        ({"world": "none.yaml"}, "spec.yaml: world: "),
        ({"frequency": 100}, "unknown key 'frequency'; did you mean 'period', 1/frequency?"),
        ({"duration": -1}, "duration: expected a number > 0.0, got -1"),
        (
            {"name": "my run"},
            "name: expected at most 60 letters, digits, _ . - and no dot first, got 'my run'",
        ),
        ({"robot": "arm.urdf"}, "arm.urdf: no such file"),
        ({"supervisor": "yes"}, "supervisor: expected true or false or a mapping or nothing, got text 'yes'"),
        ({"grids": {"proportional": {"gain": 5}}}, "grids.proportional.gain: expected a list"),
    ],
)
def test_in_an_experiment(here, capsys, change, message):  # noqa: F811
    (here / "stars.txt").touch()
    spec = {key: value for key, value in {**SPEC, **change}.items() if value is not None}
    (here / "spec.yaml").write_text(yaml.safe_dump(spec))
    code, _, err = call("check", "spec.yaml", capsys=capsys)
    assert (code, err.count("\n")) == (2, 1), err
    assert message in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("run", "parameter SPEC requires an argument; see dqcontrol run --help"),
        ("run spec", "spec: no such file; did you mean 'spec.yaml'?"),
        ("run nothing.yaml", "nothing.yaml: no such file\n"),
        ("run spec.yml", "did you mean 'spec.yaml'?"),
        ("run folder", "folder: is a folder; did you mean 'folder/spec.yaml'?"),
        ("run tab.yaml", "tab.yaml:2: found character '\\t' that cannot start any token; indent with spaces"),
        ("run colon.yaml", "put a space after each colon"),
        ("run spec.yaml spec.yaml", "takes no further argument, got 'spec.yaml'; see dqcontrol run --help"),
        ("run spec.yaml --jobs two", 'unable to convert "two" into int; see dqcontrol run --help'),
        ("sweep spec.yaml", "missing key 'sweep'; a study without it is run with 'dqcontrol run'"),
        ("robots iiwa7", "there is no command 'iiwa7'; see dqcontrol robots --help"),
        ("robots view iwa7", "did you mean 'iiwa7'?"),
        ("robots solve iiwa7 --position 5 5 5", "m beyond the reach of iiwa7"),
        ("view spec.yaml", "if it is an experiment: dqcontrol run spec.yaml"),
        ("report", "give at least one folder of a run or a study"),
        ("report folde", "folde: no such file; did you mean 'folder'?"),
        ("clip folder a.mp4", "is not the folder of a run"),
        ("clip folder a.jpg", "a.jpg: must end in .png, .gif, .mp4, .webp, got '.jpg'"),
        (
            "gains iiwa7 --period 8ms --delay fast",
            "expected a number in s, or with a unit as 8ms, got 'fast'",
        ),
        ("paint spec.yaml", "expected a .svg or a .txt file, got '.yaml'"),
        ("robots solve iiwa7 --position 0.4 0 0.5 --top 0", "Must be >= 1"),
        ("new no/spec.yaml --yes", "no/spec.yaml: cannot be written: No such file or directory"),
        ("new spec.yaml --yes", "exists already; choose another name, or replace it with --force"),
        ("list law", "there is no command 'law'; did you mean 'laws'? See dqcontrol list --help"),
        ("rnu", "there is no command 'rnu'; did you mean 'run'? See dqcontrol --help"),
        ("help", "did you mean '--help'? See dqcontrol --help"),
    ],
)
def test_at_the_command_line(here, capsys, words, message):  # noqa: F811
    (here / "tab.yaml").write_text("name: a\n\trobot: b\n")
    (here / "colon.yaml").write_text("name:tiny\nrobot:iiwa7\n")
    (here / "folder").mkdir()
    (here / "folder/spec.yaml").write_text("name: a\n")
    code, _, err = call(*words.split(), capsys=capsys)
    assert (code, err.count("\n")) == (2, 1), err
    assert message in err
