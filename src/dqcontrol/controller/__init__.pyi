from .controller import Controller as Controller
from .task_levels import (
    FurtherTask as FurtherTask,
    PreparedTasks as PreparedTasks,
)
