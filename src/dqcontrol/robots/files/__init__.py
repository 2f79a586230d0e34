"""Robot files: YAML, URDF, xacro and MJCF."""
