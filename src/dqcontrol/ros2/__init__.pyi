from .middleware import check_installed as check_installed
from .repeated_motion import launch_pair as launch_pair
