from .camera import (
    Camera as Camera,
)
from .camera import (
    FiducialLoss as FiducialLoss,
)
from .compliant import CompliantPlant as CompliantPlant
from .compliant.loads_and_faults import (
    EncoderLoss as EncoderLoss,
)
from .compliant.loads_and_faults import (
    Payload as Payload,
)
from .compliant.loads_and_faults import (
    Push as Push,
)
from .compliant.loads_and_faults import (
    WristFault as WristFault,
)
from .compliant.obstacle import Obstacle as Obstacle
from .compliant.payload_compensation import PayloadCompensation as PayloadCompensation
from .coppeliasim import CoppeliaPlant as CoppeliaPlant
from .disturbance import (
    BandLimitedTwist as BandLimitedTwist,
)
from .disturbance import (
    ConstantTwist as ConstantTwist,
)
from .disturbance import (
    Disturbance as Disturbance,
)
from .disturbance import (
    SinusoidalTwist as SinusoidalTwist,
)
from .disturbance import (
    WorstCase as WorstCase,
)
from .integrator import Integrator as Integrator
from .live_plant import (
    LivePlant as LivePlant,
)
from .live_plant import (
    MovedPlant as MovedPlant,
)
from .mobile import MobilePlant as MobilePlant
from .mobile.gripper import (
    Gripper as Gripper,
)
from .mobile.gripper import (
    GripperEvent as GripperEvent,
)
from .mobile.odometry import Odometry as Odometry
from .mobile.scene import (
    Basket as Basket,
)
from .mobile.scene import (
    Cube as Cube,
)
from .mobile.scene import (
    Scene as Scene,
)
from .mobile.scene import (
    TableBlock as TableBlock,
)
from .mobile.wheeled_base import WheeledBase as WheeledBase
from .mujoco import MujocoPlant as MujocoPlant
from .own_plant import OwnPlant as OwnPlant
from .plant import (
    CompiledPlant as CompiledPlant,
)
from .plant import (
    Plant as Plant,
)
from .plant import (
    limits_before as limits_before,
)
from .servo import (
    Servo as Servo,
)
from .servo import (
    load_servo as load_servo,
)
from .tiring_motors import TiringMotors as TiringMotors
