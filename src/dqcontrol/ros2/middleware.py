"""Starting and ending ROS 2: is it there, what may it open, and a loop that spins."""

from __future__ import annotations

import functools
import gc
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Concatenate, ParamSpec, TypeVar

from dqcontrol.errors import Error, MissingExtraError
from dqcontrol.loop.clock import real_time, threads_of_process

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.timer import Timer

_Made = TypeVar("_Made", bound="Node")
_Given = ParamSpec("_Given")
_PACKAGES = (
    "rclpy",
    "sensor_msgs.msg",
    "trajectory_msgs.msg",
    "geometry_msgs.msg",
    "nav_msgs.msg",
    "diagnostic_msgs.msg",
    "std_msgs.msg",
    "std_srvs.srv",
)
_AWAKE = 0.05  # s between two looks at whether a user wants it to end
_LOOPBACK = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # the profile says it; LOCALHOST would open more
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("loopback.xml")),
}


def check_installed() -> None:
    """Say in one line what is missing of ROS 2.

    Raises
    ------
    MissingExtraError
        If rclpy or one of the message packages is not there.
    """
    for package in _PACKAGES:
        try:
            import_module(package)
        except ImportError as error:
            raise MissingExtraError(
                f"ros2: cannot import {package.split('.')[0]} ({error}); source a ROS 2 installation, or "
                "pip install 'dqcontrol[ros2]'"
            ) from None


def stay_on_loopback() -> None:
    """Keep what ROS opens on the loopback, except where the environment says otherwise already."""
    for name, value in _LOOPBACK.items():
        os.environ.setdefault(name, value)


@contextmanager
def ros(arguments: Sequence[str], names: Sequence[str] = (), *, network: bool = False) -> Iterator[None]:
    """Start ROS 2 with its own arguments (``-r``, ``-p``, …), and end it.

    Parameters
    ----------
    arguments
        What follows ``--ros-args``.
    names
        Of the nodes to be made.
    network
        True: leave it to ROS's own settings what it opens; else it stays on the loopback.

    Raises
    ------
    Error
        If it is not installed, or ROS does not allow an argument or a name.
    """
    check_installed()
    if not network:
        stay_on_loopback()
    import rclpy
    import rclpy.utilities
    from rclpy.exceptions import InvalidNodeNameException
    from rclpy.signals import SignalHandlerOptions
    from rclpy.validate_node_name import validate_node_name

    try:
        for name in names:
            validate_node_name(name)
    except InvalidNodeNameException as error:
        lines = str(error).splitlines()[:2]  # the third points at the place
        raise Error(f"ros2: {' '.join(lines)}") from None
    words = ["dqcontrol", "--ros-args", *arguments] if arguments else ["dqcontrol"]
    try:
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy names its reasons by classes of its C library
        raise Error(f"ros2: {str(error).splitlines()[0]}") from None
    try:
        yield
    finally:
        rclpy.utilities.try_shutdown()


def destroyed_on_failure(
    construct: Callable[Concatenate[_Made, _Given], None],
) -> Callable[Concatenate[_Made, _Given], None]:
    """Let a node whose construction fails leave ROS at once.

    Else the garbage collector ends it, maybe in another thread, while ROS starts or ends another node.
    """

    @functools.wraps(construct)
    def constructing(node: _Made, /, *given: _Given.args, **options: _Given.kwargs) -> None:
        try:
            construct(node, *given, **options)
        except BaseException:
            node.destroy_node()
            raise

    return constructing


def steady_timer(node: Node, seconds: float, act: Callable[[], None]) -> Timer:
    """Return a timer that neither a simulation's time (``use_sim_time``) nor a set clock slows down or stops."""
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType

    return node.create_timer(seconds, act, clock=Clock(clock_type=ClockType.STEADY_TIME))


def spin(
    *nodes: Node,
    is_over: Callable[[], bool],
    look: Callable[[], None] = lambda: None,
    priority: int | None = None,
) -> None:
    """Serve nodes until something is over.

    One thread does everything: with several, rclpy's timers starve.

    Parameters
    ----------
    nodes
        To be served.
    is_over
        Asked after each event, and at least 20 times a second.
    look
        Called before that.
    priority
        1 … 99: asks for real-time scheduling of all threads there are, those of the middleware too.
    """
    import rclpy.utilities
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    waking = steady_timer(nodes[0], _AWAKE, lambda: None)  # a signal does not end the library's waiting
    gc.collect()
    gc.freeze()  # what is there stays; what comes is little
    try:
        with real_time(priority, threads_of_process()) if priority else nullcontext():
            while rclpy.utilities.ok():
                look()
                if is_over():
                    break
                executor.spin_once()
    finally:
        gc.unfreeze()
        waking.cancel()
        executor.shutdown()
