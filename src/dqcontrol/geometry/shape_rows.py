"""Where the numbers of a shape, and of a distance found, stand in their rows."""

KIND = 0
ROUND, PLANE, BOX, CYLINDER = 0.0, 1.0, 2.0, 3.0
# of round shapes, and of cylinders, whose core is the axis from end to end
RADIUS, CORE, ALONG, FIRST, LAST = 1, 2, 5, 8, 9
# of planes
OFFSET, NORMAL = 1, 2
# of boxes: half sizes, centre, and the rotation matrix, row by row
HALF, CENTER, ROTATION = 1, 4, 7
SHAPE = 16

DISTANCE, DIRECTION, ON_A, ON_B = 0, 1, 4, 7
FOUND = 10
