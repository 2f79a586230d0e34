"""ROS 2: a controller, and a simulated robot, as nodes at the topics of ros2_control.

Only `dqcontrol.ros2.middleware.check_installed` may be called without rclpy; the nodes' own modules import it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
