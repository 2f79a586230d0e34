"""What makes the repeats of a study differ, in words."""

from __future__ import annotations

from dqcontrol.experiments.spec import Spec


def noise_model(spec: Spec) -> str:
    """Return what is drawn from each repeat's seed: the encoders of the plants and random disturbances.

    Examples
    --------
    >>> from dqcontrol.experiments import read_spec
    >>> spec, _ = read_spec({
    ...     "name": "noise", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    ...     "law": {"kind": "proportional", "gain": 10},
    ...     "plant": {"kind": "servo", "encoder_noise": 1e-4, "encoder_resolution": 1e-3},
    ... })
    >>> noise_model(spec)
    'white encoder noise of 0.0001 rad before rounding to 0.001 rad'
    """
    plants = spec.plant_by_label
    parts = []
    for label, plant in plants.items():
        noise, step = map(_size, plant.encoder_errors())
        said = [f"white encoder noise of {noise} rad"] if noise else []
        said += [f"{'before ' if noise else 'encoders '}rounding to {step} rad"] if step else []
        if said:
            parts.append(f"{label}: {' '.join(said)}" if len(plants) > 1 else " ".join(said))
    if spec.disturbance is not None:
        parts.append("the spec's disturbance")
    return "; ".join(parts) or "none"


def _size(value: float | list[float]) -> str:
    """Return a size as text, several as their range; empty for none."""
    sizes = value if isinstance(value, list) else [value]
    if not any(sizes):
        return ""
    return f"{min(sizes):g}" if min(sizes) == max(sizes) else f"{min(sizes):g} … {max(sizes):g}"
