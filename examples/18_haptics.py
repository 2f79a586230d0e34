"""A leader that a hand moves and a follower before a board: the hand feels the board, 10 ms away each way."""

from copy import deepcopy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import yaml

import dqcontrol as dqc
from dqcontrol.experiments.driven import live_of
from dqcontrol.experiments.prepared_experiment import prepare

HAND, DAMPED = 400.0, 10.0  # N/m and N·s/m of the arm that leads
spec = yaml.safe_load((Path(__file__).parent / "haptics.yaml").read_text())
alone, there = deepcopy(spec), deepcopy(spec)
del alone["world"], there["contact"]  # the leader stands in the air, the follower gives way to nothing
leader, follower = (live_of(prepare(each)) for each in (alone, there))
both = dqc.devices.Haptics(leader, follower, delay=0.01)
limits = both.limits(environment=spec["world"]["board"]["stiffness"])
print(f"bears a board of {limits.stiffness:.0f} N/m; 1000 N/m need {limits.least_damping:.0f} N·s/m")

rows, last, origin = [], None, dqc.algebra.translation(leader.state.pose)
for k in range(2000):
    time = k * leader.period
    wish = np.add(origin, [0.03 * np.sin(np.pi * time), 0, -0.025 * min(time, 1.0) * (time < 3)])
    place = dqc.algebra.translation(leader.state.pose)
    speed = np.zeros(3) if last is None else (place - last) / leader.period
    last = place
    both.push[:3] = HAND * (wish - place) - DAMPED * speed
    both.step()
    heights = [1e3 * (dqc.algebra.translation(each.state.pose)[2] - origin[2]) for each in (leader, follower)]
    rows.append([time, 1e3 * (wish[2] - origin[2]), *heights, -both.push[2], follower.plant.wrench[2]])
time, wish, led, followed, hand, board = np.array(rows).T
pressed = (time > 2) & (time < 2.9)
print(
    f"the hand presses by {hand[pressed].mean():.2f} N, the follower by {np.abs(board[pressed].mean()):.2f} N"
)

figure, (above, below) = plt.subplots(2, 1, figsize=(7, 5), layout="constrained", sharex=True)
above.plot(time, wish, "--", color="0.6", label="where the hand leads")
above.plot(time, led, label="leader")
above.plot(time, followed, label="follower")
above.axhline(-10.0, color="0.8", lw=4, zorder=0)
above.set_ylabel("height (mm)")
above.legend()
below.plot(time, np.abs(board), color="C1", label="board on the follower")
below.plot(time, hand, color="C0", label="hand on the leader")
below.set(xlabel="time (s)", ylabel="force (N)")
below.legend()
figure.savefig("18_haptics.png", dpi=100)
