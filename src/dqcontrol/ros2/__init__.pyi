from .launch import launch_pair as launch_pair
from .middleware import check_installed as check_installed
