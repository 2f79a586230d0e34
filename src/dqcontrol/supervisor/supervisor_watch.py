"""Time, measurements, efforts and requests that a supervisor watches; they change its mode."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import apart, inline
from dqcontrol.supervisor import interventions as reason, supervisor_layout as layout
from dqcontrol.supervisor.supervisor_geometry import measured_outside, take_off_payload

_FAR = 1e6  # rad or m: no measurement says so; free, any number beyond all robots
_LONG = 1e3  # s: no gap counts as more; free, and finite, so that ways in it are
_SPEED_TIME = 0.02  # s that the measured speed is smoothed over, two periods at least
_SPEED_SLACK = 0.1  # rad/s or m/s, beside the overspeed: what encoder steps of 2 mrad make of `_SPEED_TIME`
_FROZEN_WAY = 0.02  # rad or m that a joint was told to move meanwhile
_EFFORT_TIME = 0.2  # s that the usual effort is smoothed over
# mean of so many periods; bound in T, and in the longest
_LATENESS_PERIODS, _LATEST, _LATEST_SHARE = 50.0, 2.0, 0.25


@inline
def _watch_time(elapsed, still, bounds, memory):
    """Return what is wrong with the time since the last step, and how much has passed, s."""
    head, numbers = bounds.head, memory.numbers
    is_sane = elapsed >= 0.0 and elapsed <= head[layout.LONGEST_STEP]
    passed = elapsed if elapsed >= 0.0 and elapsed <= _LONG else _LONG
    if not is_sane:
        return reason.GAP, passed
    numbers[layout.LATENESS] += (passed / head[layout.DT] - numbers[layout.LATENESS]) / _LATENESS_PERIODS
    latest = max(_LATEST, _LATEST_SHARE * head[layout.LONGEST_STEP] / head[layout.DT])
    fault = reason.PERIOD if numbers[layout.LATENESS] > latest else 0
    return fault | (reason.CLOCK if still > head[layout.LONGEST_STEP] else 0), passed


@inline
def _watch_ways(measured, passed, bounds, memory):
    """Return what jumped: cannot have come where it is said to be since the last good measurement.

    The coordinate y of a drive has no input of its own: it moves no faster than x.
    """
    head, numbers = bounds.head, memory.numbers
    numbers[layout.SILENT] += passed
    jumped = 0
    for i in range(bounds.is_joint.shape[0]):
        is_joint, j = bounds.is_joint[i] != 0.0, int(bounds.coordinate[i])
        way = abs(measured[j] - memory.good[j])
        fastest = max(head[layout.OVERSPEED], 1.0) * max(bounds.velocity[i], abs(memory.sent_rate[i]))
        farthest = fastest * numbers[layout.SILENT] + (
            head[layout.JUMP] if is_joint else head[layout.LONGEST_BASE_JUMP]
        )
        for k in range(bounds.drives.shape[0]):
            if j == int(bounds.drives[k, 0]):
                way = max(way, abs(measured[j + 1] - memory.good[j + 1]))
        if not way <= farthest:
            jumped |= reason.JUMP if is_joint else reason.BASE_JUMP
    return jumped


@inline
def _watch_joints(measured, age, passed, bounds, memory):
    """Keep a good measurement; return what is wrong with where the joints are and how they move.

    A joint is frozen by what was measured: time since the last measurement, of this age, says nothing of that.
    """
    head, numbers, good = bounds.head, memory.numbers, memory.good
    fault, running = 0, numbers[layout.MODE] == layout.RUNNING
    share = min(numbers[layout.SILENT] / max(_SPEED_TIME, 2.0 * head[layout.DT]), 1.0)
    for i in range(bounds.is_joint.shape[0]):
        if bounds.is_joint[i] == 0.0:
            continue
        j = int(bounds.coordinate[i])
        way = measured[j] - good[j]
        if numbers[layout.SILENT] > 0.0:
            memory.speed[i] += share * (way / numbers[layout.SILENT] - memory.speed[i])
        # more where the limit was lowered meanwhile
        allowed = max(bounds.velocity[i], abs(memory.sent_rate[i]))
        if abs(memory.speed[i]) > head[layout.OVERSPEED] * allowed + _SPEED_SLACK:
            fault |= reason.OVERSPEED
        if way != 0.0 or not running:
            memory.unchanged[i], memory.sent_then[i] = 0.0, memory.sent[i]
        else:
            memory.unchanged[i] += passed
            # away from where it stays
            told = abs(memory.sent[i] - good[j]) - abs(memory.sent_then[i] - good[j])
            if memory.unchanged[i] - age > head[layout.FROZEN_AFTER] and told > _FROZEN_WAY:
                fault |= reason.FROZEN
        beyond = max(bounds.lower[i] - measured[j], measured[j] - bounds.upper[i])
        if beyond > head[layout.JOINT_TOLERANCE]:
            fault |= reason.MEASURED_POSITION
    for j in range(good.shape[0]):
        good[j] = measured[j]
    numbers[layout.SILENT] = 0.0
    return fault


@apart
def _watch_efforts(memory, state, effort, wrench, passed):
    """Return what is wrong with measured efforts and the wrench at the end effector, where they are measured."""
    _, _, bounds, kept, scratch = layout.taken_apart(memory, state)
    head, fault = bounds.head, 0
    share = min(passed / _EFFORT_TIME, 1.0)
    for i in range(effort.shape[0]):
        if abs(effort[i]) > bounds.effort[i]:
            fault |= reason.EFFORT
        if not math.isfinite(kept.usual_effort[i]):
            kept.usual_effort[i] = effort[i]
        away = effort[i] - kept.usual_effort[i]
        kept.usual_effort[i] += share * away
        if abs(away) > head[layout.CONTACT_EFFORT]:
            fault |= reason.CONTACT
    if wrench.shape[0] == 6:
        contact = scratch.column
        for i in range(6):
            contact[i] = wrench[i] - head[layout.SENSOR_BIAS + i]
        if head[layout.PAYLOAD_WEIGHT] != 0.0:
            take_off_payload(memory, state)
        force = math.sqrt(contact[0] ** 2 + contact[1] ** 2 + contact[2] ** 2)
        torque = math.sqrt(contact[3] ** 2 + contact[4] ** 2 + contact[5] ** 2)
        if force > head[layout.CONTACT_FORCE] or torque > head[layout.CONTACT_TORQUE]:
            fault |= reason.CONTACT
    return fault


@inline
def judge(memory, state, parts, moment, measured, wanted, effort, wrench, at_rest):
    """Keep a good measurement, note what is wrong, change the mode; return what is wrong with this sample alone.

    Two samples in a row with something wrong stop; what else is seen stops at once.
    """
    bounds, kept = parts.bounds, parts.memory
    numbers, good, age, request = kept.numbers, kept.good, moment.age, int(moment.request)
    fault, passed = _watch_time(moment.elapsed, moment.still, bounds, kept)
    seen = age <= bounds.head[layout.STALE]
    for i in range(measured.shape[0]):
        seen = seen and abs(measured[i]) < _FAR
    for i in range(effort.shape[0]):
        seen = seen and math.isfinite(effort[i])
    for i in range(wrench.shape[0]):
        seen = seen and math.isfinite(wrench[i])
    wrong = 0
    jumped = _watch_ways(measured, passed, bounds, kept) if seen else 0
    if not seen:
        numbers[layout.SILENT] += passed
        wrong = reason.MEASUREMENT
    elif jumped:
        wrong = jumped
    else:
        fault |= _watch_joints(measured, age, passed, bounds, kept)
        if bounds.head[layout.BOXED] != 0.0 and measured_outside(memory, state):
            fault |= reason.MEASURED_WORKSPACE
        if effort.shape[0] != 0 or wrench.shape[0] != 0:
            fault |= _watch_efforts(memory, state, effort, wrench, passed)
        for i in range(wanted.shape[0]):
            if not math.isfinite(wanted[i]):
                wrong = reason.COMMAND
    numbers[layout.BAD] = numbers[layout.BAD] + 1.0 if wrong else 0.0
    if numbers[layout.BAD] >= 2.0:
        fault |= wrong
    far, near = False, True
    for i in range(wanted.shape[0]):
        if bounds.is_joint[i] != 0.0:
            distance = abs(good[int(bounds.coordinate[i])] - kept.sent[i])
            far = far or not distance <= bounds.tracking[i]
            near = near and distance <= 0.5 * bounds.tracking[i]
    if seen and far and numbers[layout.MODE] == layout.RUNNING:
        fault |= reason.TRACKING
    if request == layout.STOP:
        fault |= reason.EMERGENCY
    elif request == layout.END:
        numbers[layout.ENDING] = 1.0
    elif request == layout.FINISH:
        fault |= reason.SOFT_STOP
    if (
        numbers[layout.ENDING] != 0.0
        and numbers[layout.SCALE] == 0.0
        and at_rest
        and numbers[layout.MODE] == layout.RUNNING
    ):
        fault |= reason.SOFT_STOP
    if fault:
        # what happens to one at rest is no reason
        if numbers[layout.MODE] != layout.STOPPED or not at_rest or request == layout.STOP:
            numbers[layout.FAULT] = float(int(numbers[layout.FAULT]) | fault)
        numbers[layout.MODE] = layout.STOPPED
    elif request == layout.RESET and numbers[layout.MODE] == layout.STOPPED and at_rest and not wrong:
        numbers[layout.FAULT] = 0.0
        numbers[layout.SCALE], numbers[layout.ENDING], numbers[layout.HOLDING] = 0.0, 0.0, 0.0
        numbers[layout.LATENESS] = 1.0
        numbers[layout.MODE] = layout.RETURNING
    if numbers[layout.MODE] == layout.RETURNING and near:
        numbers[layout.MODE] = layout.RUNNING
    return wrong
