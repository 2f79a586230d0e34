"""Message packages that are in no wheel, built from their text by ROS's own generators and the system's compiler.

`python built_messages.py FOLDER` builds `control_msgs` as far as the action FollowJointTrajectory needs it; with
FOLDER on PYTHONPATH it can be imported.
"""

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

PACKAGE = "control_msgs"
TEXTS = {
    "msg/JointTolerance.msg": "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n",
    "msg/JointComponentTolerance.msg": (
        "uint16 POSITION=1\nuint16 VELOCITY=2\nuint16 ACCELERATION=3\n"
        "string joint_name\nuint16 component\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
    ),
    "action/FollowJointTrajectory.action": """\
trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
JointTolerance[] path_tolerance
JointComponentTolerance[] component_path_tolerance
JointTolerance[] goal_tolerance
JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/Duration goal_time_tolerance
---
int32 error_code
int32 SUCCESSFUL = 0
int32 INVALID_GOAL = -1
int32 INVALID_JOINTS = -2
int32 OLD_HEADER_TIMESTAMP = -3
int32 PATH_TOLERANCE_VIOLATED = -4
int32 GOAL_TOLERANCE_VIOLATED = -5
string error_string
---
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
string[] multi_dof_joint_names
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error
""",
}
NEEDED = (
    "trajectory_msgs", "builtin_interfaces", "std_msgs", "geometry_msgs", "action_msgs", "service_msgs",
    "unique_identifier_msgs",
)  # fmt: skip
DISPATCHED = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
LOADED = """\
import ctypes
from pathlib import Path

for name in {names!r}:  # the library that looks for the others by their names finds those that are loaded
    ctypes.CDLL(str(Path(__file__).parents[1] / name), mode=ctypes.RTLD_GLOBAL)
"""


def is_possible():
    """Whether generators, headers and compilers are there."""
    try:
        import rosidl_adapter  # noqa: F401
        import rosidl_generator_py  # noqa: F401
    except ImportError:
        return False
    return bool(shutil.which("g++")) and (Path(sys.prefix) / "share/rosidl_generator_c").is_dir()


def generated(folder):
    """Sources, in a folder a generator."""
    from rosidl_adapter.action import convert_action_to_idl
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    source, names = folder / "text" / PACKAGE, []
    for name, text in TEXTS.items():
        path = source / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        convert = convert_action_to_idl if path.suffix == ".action" else convert_msg_to_idl
        convert(source, PACKAGE, Path(name), path.parent)
        names.append(f"{source}:{Path(name).with_suffix('.idl')}")
    generators = {
        "generator_c": GenerateC("c"),
        "typesupport_fastrtps_c": GenerateFastRTPSCTypesupport("fastrtps_c"),
        "typesupport_introspection_c": GenerateIntrospectionCTypesupport("introspection_c"),
        "typesupport_c": GenerateCTypesupport("c", typesupport_implementations=DISPATCHED),
        "generator_py": GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"]),
    }
    for name, generator in generators.items():
        generator.generate(
            PACKAGE, names, [Path(sys.prefix) / "share", source.parent], folder / name / PACKAGE
        )
    return list(generators)


def build(folder):
    """Build the package into a folder."""
    kinds = generated(folder)
    system, package = Path(sys.prefix), folder / PACKAGE
    roots = [*(folder / kind for kind in kinds), system / "include", *(system / "include").iterdir()]
    includes = [f"-I{root}" for root in [*roots, sysconfig.get_paths()["include"], np.get_include()]]

    def link(out, sources, needed):
        compiler = ["g++", "-std=c++17"] if sources[0].suffix == ".cpp" else ["gcc"]
        where = [f"-L{folder}", f"-L{system / 'lib'}", f"-Wl,-rpath,{folder}:{system / 'lib'}"]
        subprocess.run(
            [
                *compiler, "-O0", "-w", "-fPIC", "-shared", *includes, "-o", str(out), *map(str, sources), *where,
                f"-Wl,-soname,{out.name}", *(f"-l{name}" for name in needed),
            ],
            check=True,
        )  # fmt: skip

    own, libraries = [], []
    for kind in kinds:
        sources = sorted((folder / kind).rglob("*_s.c" if kind == "generator_py" else "*.c*"))
        needed = [f"{each}__rosidl_{kind}" for each in NEEDED]
        needed += {"generator_c": ["rosidl_runtime_c"], "generator_py": []}.get(kind, [f"rosidl_{kind}"])
        needed += ["fastcdr"] * (kind == "typesupport_fastrtps_c") + own
        libraries.append(f"lib{PACKAGE}__rosidl_{kind}.so")
        link(folder / libraries[-1], sources, needed)
        own.append(f"{PACKAGE}__rosidl_{kind}")
    shutil.copytree(folder / "generator_py" / PACKAGE, package, dirs_exist_ok=True)
    module = f"{PACKAGE}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    link(package / module, [package / f"_{PACKAGE}_s.ep.rosidl_typesupport_c.c"], own)
    (package / "__init__.py").write_text(LOADED.format(names=libraries))


if __name__ == "__main__":
    build(Path(sys.argv[1]).absolute())
