"""Controllers and simulated robots as ROS 2 nodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter, validators

from dqcontrol.cli import add_offered
from dqcontrol.cli.options import Out, ReplaceResults, RosArguments, Switch

ros2: App = App(name="ros2", help="Controllers and simulated robots as ROS 2 nodes.", help_format="plaintext")

NETWORK = "Do not keep to the loopback; ROS's own settings count."


@Parameter(name="*")
@dataclass(frozen=True)
class NodeOptions:
    """What controllers and robots have in common."""

    interface: Annotated[
        Literal["velocity", "position", "trajectory", "humanoid", "effort"],
        Parameter(help="What commands are; names their topic."),
    ] = "velocity"
    base_interface: Annotated[
        Literal["twist", "twist-stamped", "wheels"], Parameter(help="What commands of a mobile base are.")
    ] = "twist"
    network: Annotated[bool, Parameter(negative=(), help=NETWORK)] = False
    priority: Annotated[
        int | None,
        Parameter(validator=validators.Number(gte=1, lte=99), help="1 … 99: ask for real-time scheduling."),
    ] = None


_DEFAULTS = NodeOptions()


@ros2.command
def controller(
    spec: Path,
    /,
    *ros_arguments: RosArguments,
    name: str = "dqcontrol",
    follow: Literal["spec", "pose", "twist", "servo", "haptics"] = "spec",
    options: NodeOptions = _DEFAULTS,
    autostart: Switch = False,
    out: Out = None,
    force: ReplaceResults = False,
    tracker: str | None = None,
) -> None:
    """Drive a robot behind ROS 2 topics; see docs/ros2.md.

    Parameters
    ----------
    spec
        YAML file of one run: its robot, law and reference.
    name
        Of the node.
    follow
        What the end effector follows: the spec's reference, poses or twists from topics, the topics of MoveIt Servo, or
        poses of a leader that feels what it does.
    autostart
        Start with the first joint states; end when the reference has ended or the robot was stopped.
    out
        New folder for recordings of the motions, which `dqcontrol view` shows while they run.
    tracker
        Topic of poses of the end effector that a tracker measures; they are kept beside the recording.
    """
    from dqcontrol.loop.interrupts import counted_interrupts

    with counted_interrupts() as interrupts:  # from now on: what follows takes seconds
        from dqcontrol.errors import Error
        from dqcontrol.experiments import read_spec
        from dqcontrol.experiments.results_folder import check_new
        from dqcontrol.ros2 import middleware

        middleware.check_installed()
        if tracker and out is None:
            raise Error("--tracker: its poses are kept beside a recording; give --out, too")
        read_spec(spec)  # a wrong file is to be known now, not when somebody configures
        if out:
            check_new(out, force=force)
        interrupts.only_count()  # in the middle of ROS's start an exception would leave threads that never end
        with middleware.ros(ros_arguments, [name], network=options.network):
            from dqcontrol.ros2.controller_node import ControllerNode
            from dqcontrol.ros2.tracked_hand import TRACKED

            node = ControllerNode(
                spec,
                name=name,
                source=follow,
                interface=options.interface,
                base_interface=options.base_interface,
                autostart=autostart,
                out=out,
                force=force,
                tracker=tracker,
            )
            node.serve(interrupts, options.priority)
        if node.recorder:
            folder = node.recorder.save()
            if node.following and node.following.tracked:
                node.following.tracked.write(folder / TRACKED)
            print(f"results: {folder}")
        if node.outcome not in ("", "duration", "interrupted"):
            raise Error(f"stopped: {node.outcome}")


@ros2.command
def robot(
    spec: Path,
    /,
    *ros_arguments: RosArguments,
    name: str = "robot",
    options: NodeOptions = _DEFAULTS,
    wrench_node: str | None = None,
    tracker: str | None = None,
) -> None:
    """Simulate a robot behind ROS 2 topics; see docs/ros2.md.

    Parameters
    ----------
    spec
        YAML file of one run: its robot, start and plant.
    name
        Of the node.
    wrench_node
        Name of another node that publishes the wrench, of plants that have one.
    tracker
        Topic that says where the end effector truly is, as a tracker would.
    """
    from dqcontrol.loop.interrupts import counted_interrupts

    with counted_interrupts() as interrupts:
        from dqcontrol.ros2 import middleware
        from dqcontrol.ros2.loading import load_simulated

        middleware.check_installed()
        loaded = load_simulated(spec)
        names = [name, *([wrench_node] if wrench_node else [])]
        interrupts.only_count()  # as above
        with middleware.ros(ros_arguments, names, network=options.network):
            from dqcontrol.ros2.robot_node import RobotNode

            node = RobotNode(
                loaded,
                name=name,
                interface=options.interface,
                base_interface=options.base_interface,
                wrench_node=wrench_node,
                tracker=tracker,
            )
            middleware.spin(*node.nodes, is_over=lambda: interrupts.count > 0, priority=options.priority)


@ros2.command
def send(
    run: Path,
    /,
    *ros_arguments: RosArguments,
    name: str = "dqcontrol",
    action: str = "/joint_trajectory_controller/follow_joint_trajectory",
    network: Annotated[bool, Parameter(negative=(), help=NETWORK)] = False,
) -> None:
    """Send the motion of a run, as one goal, to an arm that offers no more than FollowJointTrajectory.

    Parameters
    ----------
    run
        Folder of a run of an arm, which begins at rest; if it ends on the way, it brakes.
    name
        Of the node.
    action
        Name of the action.
    """
    from dqcontrol.loop.interrupts import counted_interrupts

    with counted_interrupts() as interrupts:
        from dqcontrol.errors import Error
        from dqcontrol.experiments import load_run
        from dqcontrol.ros2 import middleware

        middleware.check_installed()
        motion = load_run(run)
        interrupts.only_count()  # as above
        with middleware.ros(ros_arguments, [name], network=network):
            from dqcontrol.ros2.trajectory_goal import TrajectoryGoal

            goal = TrajectoryGoal(motion, name=name, action=action)
            goal.serve(interrupts)
        if not goal.is_done:
            raise Error(f"ros2: {goal.outcome or 'left while it moved'}")
        print(f"done: {goal.length}")


add_offered(ros2, "dqcontrol.commands.ros2")
