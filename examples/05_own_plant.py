"""A plant of your own: joints with backlash. The law sees the motors; the hand hangs on the joints behind the gears."""

import numpy as np

import dqcontrol as dqc


def backlash(command, parameters, noise, state, q, measured):
    """Motors do as they are told; a joint follows once its motor has crossed the play, parameters[1] rad wide."""
    for i in range(q.shape[0]):
        measured[i] += parameters[0] * command[i]  # parameters[0] is the period, s
        q[i] = min(max(q[i], measured[i] - 0.5 * parameters[1]), measured[i] + 0.5 * parameters[1])


arm, start = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
square = dqc.references.Square(arm.fkm(start), side=0.1, duration=10.0)
smooth = dqc.references.CornerStops(square, seconds=0.3)
law = dqc.laws.ProportionalFeedforward(gain=10.0)
plants = {
    f"{1000 * play:g} mrad of play": dqc.plants.OwnPlant(function=backlash, parameters=[play])
    for play in (0.0, 0.02)
}
records = {
    label: dqc.simulate(arm, smooth, law, plant, start=start, period=0.01) for label, plant in plants.items()
}
for label, record in records.items():
    print(f"{label}: largest error {dqc.measures.evaluate(record).position.peak:.2f} mm")
dqc.figures.compare_paths(records).savefig("05_own_plant.png", dpi=150)
