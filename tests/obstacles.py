"""Bodies of the world as tests give them, each with how a robot keeps clear of it."""

import numpy as np

import dqcontrol as dqc


def sphere(center, radius, **given):
    return _obstacle({"sphere": radius, "position": tuple(center)}, given)


def capsule(start, end, radius, **given):
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    middle = tuple(0.5 * (start + end))
    return _obstacle({"capsule": (radius, length), "position": middle, "rpy": towards(end - start)}, given)


def column(point, radius, direction=(0, 0, 1), **given):
    """Return a cylinder that ends far away."""
    shape = {"cylinder": (radius, 20.0), "position": tuple(point), "rpy": towards(direction)}
    return _obstacle(shape, given)


def plane(normal, offset, **given):
    unit = np.asarray(normal, float) / np.linalg.norm(normal)
    place = tuple(offset / np.linalg.norm(normal) * unit)
    return _obstacle({"plane": tuple(unit), "position": place}, given)


def box(position, size, **given):
    rpy = given.pop("rpy", (0.0, 0.0, 0.0))
    return _obstacle({"box": size, "position": tuple(position), "rpy": rpy}, given)


def floor_map(file, **given):
    return _obstacle({"map": file}, given)


def towards(direction):
    """Return roll, pitch and yaw that turn z to a direction."""
    x, y, z = np.asarray(direction, float) / np.linalg.norm(direction)
    return 0.0, float(np.arccos(np.clip(z, -1, 1))), float(np.arctan2(y, x))


def around(obstacles):
    """Return what constraints say of bodies by name."""
    bodies = {name: body for name, (body, _) in obstacles.items()}
    return {
        "world": dqc.World(bodies=bodies),
        "clear_of": {name: clear for name, (_, clear) in obstacles.items()},
    }


def _obstacle(shape, given):
    motion = {key: given.pop(key) for key in ("velocity", "path", "speed") if key in given}
    moves = dqc.world.Motion(**motion) if motion else None
    return dqc.world.Body(**shape, moves=moves), dqc.constraints.ClearOf(**given)
