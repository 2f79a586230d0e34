"""The compliant Meka in physics, identified as if its joints were servos: what the replay's hand is worth."""

import sys

import pytest
import yaml

import dqcontrol as dqc

START = [0, 0.6283185, 0, 1.5707963, 0, 0.6283185, 0]
PATHS = [
    {"kind": "circle", "radius": 0.06, "duration": 6, "ramp": 0.5},
    {"kind": "circle", "radius": 0.05, "duration": 4, "ramp": 0.5, "plane": "xz"},
]


@pytest.mark.slow
def test_fitted_servos_predict_the_hands_error_on_other_paths(tmp_path):
    pytest.importorskip("mujoco")
    motion = dqc.excite(
        "meka-a2", START, duration=60, period=0.008, amplitude=0.3, speed=0.8, acceleration=4.0
    )
    file = motion.save(tmp_path / "excite") / "excite.yaml"
    file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | {"plant": {"kind": "compliant"}}))
    dqc.run(file).save(tmp_path / "log", figures=False)
    found = dqc.identify(tmp_path / "log", "meka-a2")
    found.save(tmp_path / "servos")
    servos = {"kind": "servo", "file": str(tmp_path / "servos" / "plant.yaml")}
    ratios = {}
    # The default feed-forward leads each plant by what is known of it: here both get the same commands' law.
    laws = ({"kind": "proportional"}, {"kind": "proportional-feedforward", "feedforward": "printed"})
    for law in laws:
        for number, path in enumerate(PATHS):
            spec = {
                "name": "path",
                "robot": "meka-a2",
                "start": START,
                "period": 0.008,
                "reference": path,
                "law": law | {"gain": 3},
            }
            rms = [
                dqc.run(spec | {"plant": plant}).metrics.position.rms
                for plant in (servos, {"kind": "compliant"})
            ]
            ratios[law["kind"], number] = rms[0] / rms[1]
    print({key: round(value, 3) for key, value in ratios.items()}, file=sys.stderr)
    assert all(0.7 < ratio < 1.3 for ratio in ratios.values()), ratios
