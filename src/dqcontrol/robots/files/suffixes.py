"""How the files of robots that others write end."""

URDF = ".urdf"
XACRO = ".xacro"  # expanded to URDF first
MJCF = ".xml"
