"""Columns of a shape's row, and of a distance's."""

KIND = 0
ROUND, PLANE, BOX, CYLINDER, HULL = 0.0, 1.0, 2.0, 3.0, 4.0
# of round shapes, and of cylinders, whose core is the axis from end to end
RADIUS, CORE, ALONG, FIRST, LAST = 1, 2, 5, 8, 9
# of planes
OFFSET, NORMAL = 1, 2
# of boxes: half sizes, centre, and the rotation matrix, row by row
HALF, CENTER, ROTATION = 1, 4, 7
# of hulls, with centre and rotation as of boxes: where in the row their corners begin, in their own axes, how many
# these are, and how far the farthest is from the centre
FIRST_CORNER, CORNERS, EXTENT = 1, 2, 3
SHAPE = 16  # without the corners of hulls

DISTANCE, DIRECTION, ON_A, ON_B = 0, 1, 4, 7
FOUND = 10
