"""Random shapes, and how Coal calls them."""

import numpy as np

from dqcontrol import algebra, geometry

KINDS = ("point", "line", "sphere", "infinite cylinder", "capsule", "plane", "box", "hull")


def random_pose(rng, spread=1.0):
    rotation = rng.normal(size=4)
    return algebra.pose(rotation / np.linalg.norm(rotation), rng.uniform(-spread, spread, 3))


def random_shape(kind, rng, spread=0.5):
    at, along = rng.uniform(-spread, spread, 3), rng.normal(size=3)
    radius = rng.uniform(0.02, 0.2)
    match kind:
        case "point":
            return geometry.Point(at)
        case "line":
            return geometry.Line(at, along)
        case "sphere":
            return geometry.Sphere(at, radius)
        case "infinite cylinder":
            return geometry.InfiniteCylinder(at, along, radius)
        case "cylinder":
            return geometry.Cylinder(at, at + rng.uniform(0.05, 0.6) * along, radius)
        case "capsule":
            return geometry.Capsule(at, at + rng.uniform(0.05, 0.6) * along, radius)
        case "plane":
            return geometry.Plane(along, rng.uniform(-spread, spread))
        case "box":
            return geometry.Box(random_pose(rng, spread), rng.uniform(0.05, 0.5, 3))
        case "hull":
            return geometry.Hull(random_pose(rng, spread), rng.uniform(-0.3, 0.3, (rng.integers(6, 40), 3)))
    raise AssertionError(kind)


def coal_shape(coal, shape):
    """Return Coal's geometry and where it is."""
    if isinstance(shape, geometry.Box):
        matrix = algebra.matrix_from_pose(shape.pose)
        return coal.Box(*shape.size), coal.Transform3s(matrix[:3, :3], matrix[:3, 3])
    if isinstance(shape, geometry.Sphere):
        return coal.Sphere(shape.radius), coal.Transform3s(np.eye(3), shape.center)
    if isinstance(shape, geometry.Plane):
        return coal.Halfspace(shape.normal, shape.offset), coal.Transform3s(np.eye(3), np.zeros(3))
    if isinstance(shape, geometry.Hull):
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(shape.corners)
        triangles.extend([coal.Triangle(*map(int, face)) for face in shape.faces])
        return coal.Convex(points, triangles), coal.Transform3s(np.eye(3), np.zeros(3))
    axis = shape.end - shape.start
    length = np.linalg.norm(axis)
    z = axis / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return (
        (coal.Cylinder if isinstance(shape, geometry.Cylinder) else coal.Capsule)(shape.radius, length),
        coal.Transform3s(rotation, 0.5 * (shape.start + shape.end)),
    )


def coal_distance(coal, a, b):
    request, result = coal.DistanceRequest(True, True), coal.DistanceResult()
    request.gjk_tolerance = 1e-12
    return coal.distance(*coal_shape(coal, a), *coal_shape(coal, b), request, result)
